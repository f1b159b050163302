"""The whole of a station in operation, with a range that is not there: flown, recorded, ended softly, replayed."""

import errno
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from groundstation import __version__
from groundstation.cli.main import main
from groundstation.geometry.camera import Lens
from groundstation.live.guarded_sink import GuardedSink
from groundstation.messages import ReferenceFix, StepReport
from groundstation.replay.provenance import hash_of
from groundstation.rig.covariance import ParameterCovariance
from groundstation.rig.rig import Rig
from groundstation.rig.rig_toml import rig_to_toml
from groundstation.session import load_dgps, load_session
from groundstation.simulation.standard_cases import standard_rig
from groundstation.sources.session_source import session_source

ROOT = Path(__file__).resolve().parents[2]


def small_rig() -> Rig:
    """The standard rig with pictures of a quarter of the size: rendering has to be quick here, not good."""
    rig = standard_rig(sigma_rad=float(np.radians(0.005)))
    lens = Lens(
        image_size_px=(320, 240),
        focal_px=np.array([1667.0, 1667.0]),
        principal_point_px=np.array([159.5, 119.5]),
        distortion=np.zeros(5),
    )
    return replace(rig, stations=tuple(replace(s, lens=lens) for s in rig.stations))


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory, classic_tuning: Path) -> tuple[Path, str, int]:
    """Operate until enough of at least two dozen pairs are tracked, then Ctrl-C; return folder, output, code.

    However loaded the machine is: landings follow each other, and a run with hardly any track (a tenth of its pairs)
    ends with another code. Next to other processes the learned channel may search for 0.7 s a pair, so that it finds
    and loses the aircraft over and over; by what it is found does not matter here.
    """
    folder = tmp_path_factory.mktemp("live")
    (folder / "small.toml").write_text(rig_to_toml(small_rig()), encoding="utf-8")
    out = folder / "out"
    command = [
        sys.executable,
        "-m",
        "groundstation",
        "live",
        "--details",
        "--simulate",
        "--rig",
        str(folder / "small.toml"),
        "--config",
        str(classic_tuning),
    ]
    child = subprocess.Popen(
        [*command, "--dgps", "--out", str(out), "--rate", "5"],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    try:
        deadline = time.monotonic() + 240.0
        while time.monotonic() < deadline and child.poll() is None:
            tables = [out / "track.csv", out / "dgps.csv"]
            if all(t.is_file() for t in tables):
                rows = tables[0].read_text(encoding="utf-8").splitlines()
                if len(rows) > 24 and sum("tracking" in row for row in rows) > max(12, len(rows) // 5):
                    break
            time.sleep(0.2)
        child.send_signal(signal.SIGINT)
        reported, _ = child.communicate(timeout=120)
    finally:
        child.kill()
    return out, reported, child.returncode


def test_ctrl_c_ends_it_softly(flown: tuple[Path, str, int]) -> None:
    out, reported, code = flown
    assert code == 0, reported
    assert "Traceback" not in reported
    assert "delay from a pair's first frame to its answer" in reported
    # at the start of every five seconds, a line for people
    assert "its clock " in reported
    assert "GB free" in reported
    assert "recorded: " in reported
    for name in ("track.csv", "triangulation.csv", "detections.csv", "flight.mcap", "rig.toml", "dgps.csv"):
        assert (out / name).is_file(), reported
    rows = (out / "track.csv").read_text(encoding="utf-8").splitlines()
    assert len(rows) > 24
    # both cameras, processed by both pipelines' thread
    assert {line.split(",")[1] for line in (out / "detections.csv").read_text().splitlines()[1:]} == {"left", "right"}


def test_its_folder_says_where_it_comes_from(flown: tuple[Path, str, int], classic_tuning: Path) -> None:
    out, _, _ = flown
    told = json.loads((out / "provenance.json").read_text(encoding="utf-8"))
    assert told["command"].startswith("groundstation live --details --simulate")
    assert told["version"] == __version__
    assert told["machine"]["cores"] == os.cpu_count()
    assert told["station"] is None
    assert told["configuration"] == {"path": str(classic_tuning), "sha256": hash_of([classic_tuning])}
    assert told["rig"]["sha256"] == hash_of([Path(told["rig"]["path"])]) is not None


@pytest.mark.usefixtures("unrendered_figures")
def test_its_recording_gives_the_same_track_bit_for_bit(flown: tuple[Path, str, int], tmp_path: Path) -> None:
    out, _, _ = flown
    assert main(["replay", str(out / "flight.mcap"), "--out", str(tmp_path / "again"), "--no-rerun"]) == 0
    assert (tmp_path / "again" / "track.csv").read_bytes() == (out / "track.csv").read_bytes()
    assert (tmp_path / "again" / "triangulation.csv").read_bytes() == (out / "triangulation.csv").read_bytes()


def test_the_reference_receiver_is_in_it(flown: tuple[Path, str, int]) -> None:
    out, reported, _ = flown
    rows = (out / "dgps.csv").read_text(encoding="utf-8").splitlines()
    session = load_session(out / "flight.mcap")
    fixes = load_dgps(session)
    assert len(fixes) == len(rows) - 1 > 0, reported
    with session_source(session, None, None, lambda line: None) as source:
        learnt = [e for e in source if isinstance(e, ReferenceFix)]
    # the last may have come while the heads were parked
    assert 0 <= len(fixes) - len(learnt) <= 2
    assert learnt[0].t_s == pytest.approx(fixes[0].t_s, abs=1e-6)
    # it is on its way to where its approach begins, at 560 m
    assert 0.0 < learnt[0].position_runway_m[1] < 800.0


def test_a_tuning_that_is_not_there_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["live", "--simulate", "--out", str(tmp_path / "out"), "--config", str(tmp_path / "none.toml")]) == 1
    assert f"{tmp_path / 'none.toml'}: " in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_folder_that_is_in_use_is_refused(flown: tuple[Path, str, int], capsys: pytest.CaptureFixture[str]) -> None:
    out, _, _ = flown
    # a station in an empty folder would not end
    assert (out / "track.csv").is_file()
    assert main(["live", "--simulate", "--out", str(out)]) == 1
    assert "wanted a new or empty folder" in capsys.readouterr().err


def test_without_a_station_file_the_message_states_the_need(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["live"]) == 2
    assert "--simulate" in capsys.readouterr().err
    assert main(["live", "nowhere.toml", "--out", "x"]) == 1
    assert "nowhere.toml: got no such file" in capsys.readouterr().err
    assert not Path("x").exists()
    assert main(["check", "nowhere.toml"]) == 1
    assert "nowhere.toml: got no such file" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "reported"),
    [
        (["field.toml", "--simulate", "--out", "x"], "got field.toml and --simulate; wanted one of them"),
        (["field.toml", "--config", "f.toml"], "got --config without --simulate; wanted both"),
        (["field.toml", "--ptu-fault", "noise"], "got --ptu-fault without --simulate; wanted both"),
        (["field.toml", "--faults", "f.toml"], "got --faults without --simulate; wanted both"),
        (["field.toml", "--aircraft", "jsbsim"], "got --aircraft without --simulate; wanted both"),
        (["--simulate"], "got no --out; wanted a folder"),
        (["--simulate", "--out", "x", "--ptu-fault", "bogus"], "got 'bogus'; wanted one of banner, "),
    ],
)
def test_options_that_do_not_go_together_are_refused(
    words: list[str], reported: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["live", *words]) == 2
    assert reported in capsys.readouterr().err


@pytest.mark.parametrize("words", [["--seed", "-1"], ["--rate", "1e9"], ["--wind", "99"], ["--aircraft", "kite"]])
def test_what_no_range_can_do_is_refused(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["live", "--simulate", "--out", "x", *words])
    assert ended.value.code == 2
    assert words[1] in capsys.readouterr().err


def test_without_jsbsim_the_message_states_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "jsbsim", None)
    assert main(["live", "--simulate", "--out", str(tmp_path / "x"), "--aircraft", "jsbsim"]) == 1
    assert "pip install 'groundstation[jsbsim]'" in capsys.readouterr().err


def check_without_devices(tmp_path: Path, rig: Rig) -> int:
    (tmp_path / "rig.toml").write_text(rig_to_toml(rig), encoding="utf-8")
    (tmp_path / "station.toml").write_text(
        f"""format = "groundstation-station/1"
[[station]]
name = "left"
camera = "file:{ROOT}/recordings/landing-1/left.mp4"
ptu = "{tmp_path}/nothing"
[[station]]
name = "right"
camera = "file:{tmp_path}/none.mp4"
ptu = "{tmp_path}/nothing-either"
""",
        encoding="utf-8",
    )
    return main(["check", str(tmp_path / "station.toml"), "--for", "2"])


def test_check_says_whose_covariance_is_missing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The rig's own table states the left station's, and says nothing about the right one."""
    known = ParameterCovariance(names=("left.runway_from_base.z",), matrix=np.array([[1e-8]]))
    assert check_without_devices(tmp_path, replace(small_rig(), shared_covariance=known)) == 1
    assert "WRONG  rig: right without a covariance" in capsys.readouterr().out


def test_check_reports_faults_line_by_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert check_without_devices(tmp_path, small_rig()) == 1
    reported = capsys.readouterr().out.splitlines()
    assert reported[0] == "ok     station file, rig and tuning: left, right"
    assert reported[1].startswith("WRONG  rig: left, right without a covariance")
    assert any(
        "left camera: got pictures of 1280 × 960 px; wanted 320 × 240 px as in the rig" in line for line in reported
    )
    assert any(line.startswith("WRONG  left: PTU:") and "nothing" in line for line in reported)
    assert any(line.startswith("WRONG  right camera:") and "none.mp4" in line for line in reported)
    assert not any("left camera: left:" in line or "left: left:" in line for line in reported)


class FullDisk:
    """A sink whose disk takes one report."""

    def __init__(self) -> None:
        self.taken = 0

    def write(self, report: StepReport) -> None:
        self.taken += 1
        if self.taken > 1:
            raise OSError(errno.ENOSPC, "No space left on device")

    def close(self) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")


def test_a_full_disk_ends_only_the_tables() -> None:
    disk, faults = FullDisk(), list[str]()
    sink = GuardedSink(disk, faults)
    for _ in range(5):
        sink.write(StepReport())
    assert disk.taken == 2
    assert faults == ["track files end here: No space left on device"]
    sink.close()
    assert faults[1:] == ["track files are not whole: No space left on device"]


def test_another_files_fault_does_not_end_the_tables() -> None:
    """Expected: the disk's error for `dgps.csv` is reported in the same list, and the track's tables continue."""
    disk, faults = FullDisk(), ["dgps.csv ends here: No space left on device"]
    sink = GuardedSink(disk, faults)
    sink.write(StepReport())
    assert disk.taken == 1
    assert len(faults) == 1
