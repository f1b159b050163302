"""`groundstation simulate`: the session loads, its pictures agree with its truth, and a replay tracks the target."""

import threading
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from groundstation.cli.main import main
from groundstation.errors import ConfigError
from groundstation.messages import Frame
from groundstation.replay.replay import ReplayRequest, replay
from groundstation.rig.rig import Rig
from groundstation.rig.rig_toml import rig_to_toml
from groundstation.session import load_dgps, load_session, load_truth
from groundstation.simulation import simulate
from groundstation.simulation.event_faults import FaultKind
from groundstation.simulation.flights import FlightName, flight, rendered_scenario
from groundstation.simulation.picture_writer import PictureFormat
from groundstation.simulation.render_flight import RenderRequest, load_faults, render_flight
from groundstation.simulation.rendered_camera import RenderedCamera
from groundstation.simulation.rendered_scene import RenderedScene
from groundstation.sources.folder_source import FolderSource
from tests.complaints import complaint
from tests.simulation.small_site import QUIET, small_rig

pytestmark = pytest.mark.usefixtures("unrendered_figures")

NEARER_M = np.array([0.0, 250.0, 0.0])


def written(path: Path, rig: Rig) -> Path:
    path.write_text(rig_to_toml(rig), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def rig_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("rig") / "rig.toml", small_rig())


@pytest.fixture(scope="module")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first 5 s of a landing, from 270 m away: small cameras are further up the runway."""
    folder = tmp_path_factory.mktemp("filmed") / "s"
    plain = small_rig(3300.0, (640, 480))
    nearer = tuple(replace(s, ptu_position_m=s.ptu_position_m + NEARER_M) for s in plain.stations)
    rig = written(folder.parent / "rig.toml", replace(plain, stations=nearer))
    result = render_flight(RenderRequest(out=folder, rig=rig, duration_s=5.0, wind_m_s=3.0, seed=5))
    assert result.pairs == 51
    return folder


def test_an_interrupt_while_the_first_picture_compiles_ends_it(
    rig_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: it is drawn by the thread that hears interrupts; a pool would be waited for."""
    drawn_by: list[bool] = []

    def interrupted(*_: object) -> None:
        drawn_by.append(threading.current_thread() is threading.main_thread())
        raise KeyboardInterrupt

    monkeypatch.setattr(RenderedCamera, "film", interrupted)
    with pytest.raises(KeyboardInterrupt):
        render_flight(RenderRequest(out=tmp_path / "s", rig=rig_file, duration_s=1.0))
    assert drawn_by == [True]


def frames(folder: Path) -> list[Frame]:
    with FolderSource(load_session(folder)) as source:
        return [event for event in source if isinstance(event, Frame)]


def test_a_replay_follows_it_with_an_honest_covariance(filmed: Path, tmp_path: Path) -> None:
    result = replay(ReplayRequest(session=filmed, out=tmp_path / "o", rerun=False))
    assert result.fault is None
    truth = load_truth(load_session(filmed))
    assert truth is not None
    rows = [r.split(",") for r in (tmp_path / "o" / "track.csv").read_text(encoding="utf-8").splitlines()[1:]]
    tracked = [r for r in rows if r[-1] == "tracking"]
    assert len(tracked) > 15, [r[-1] for r in rows]
    squares = []
    for row in tracked:
        values = [float(cell) for cell in row[:-1]]
        k = int(np.argmin(np.abs(truth.t_s - values[0])))
        error = np.array(values[1:4]) - truth.position_runway_m[k]
        xx, xy, xz, yy, yz, zz = values[7:13]
        squares.append(error @ np.linalg.solve([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], error) / 3.0)
        assert np.hypot(error[0], error[2]) < 0.5
    # neighbouring errors are alike: far fewer than so many independent ones
    assert np.mean(squares) < 4.0


def test_tables_pictures_and_masks_belong_together(filmed: Path) -> None:
    session = load_session(filmed)
    truth = load_truth(session)
    assert truth is not None
    assert session.target.span_m == pytest.approx(2.3)
    assert len(load_dgps(session)) >= 30
    masks = np.load(filmed / "masks.npz")
    taken = frames(filmed)
    assert len(taken) == 102
    for frame in taken[::25]:
        image = frame.image.whole().astype(np.float64)
        mask, (x, y) = masks[f"{frame.station}_{frame.epoch:04d}"], masks[f"{frame.station}_{frame.epoch:04d}_xy"]
        h, w = mask.shape
        inside = image[y : y + h, x : x + w][mask > 0].mean()
        around = image[y - 6 : y + h + 6, x - 6 : x + w + 6].mean()
        assert inside < around - 8.0, "the aircraft is darker than the sky, where the mask is"


def test_truth_with_a_rolling_shutter_is_the_simulator_s() -> None:
    """The renderer's nose and the angle-level simulator's are the same, rolling shutter and rates included."""
    plain = small_rig()
    rig = replace(plain, stations=tuple(replace(s, readout_s=0.02) for s in plain.stations))
    flown = simulate(rendered_scenario(flight(FlightName.WEAVE, wind_m_s=6.0, seed=2), rig))
    camera = RenderedCamera(RenderedScene(trajectory=flown.scenario.trajectory), rig["left"], QUIET)
    station = flown.truth.stations["left"]
    compared = 0
    for k in range(0, station.t_s.size, 20):
        truth = camera.truth(float(station.t_s[k]), *station.angles_rad[k], *station.rates_rad_s[k])
        assert truth.visible == station.visible[k]
        if truth.visible:
            # angles between the rows are extrapolated at a constant rate
            np.testing.assert_allclose(truth.pixel_px, station.pixel_px[k], atol=0.02)
            compared += 1
    assert compared > 5


def test_faults_are_in_the_session_and_seeds_repeat(rig_file: Path, tmp_path: Path) -> None:
    timetable = tmp_path / "faults.toml"
    timetable.write_text(
        '[[fault]]\nwhat = "camera_lost"\nstation = "left"\nfrom_s = 0.35\nto_s = 0.55\n'
        '[[fault]]\nwhat = "camera_frozen"\nstation = "right"\nfrom_s = 0.55\n'
        '[[fault]]\nwhat = "ptu_silent"\nstation = "right"\nfrom_s = 0.2\nto_s = 0.4\n',
        encoding="utf-8",
    )
    for name in ("one", "two"):
        request = RenderRequest(
            out=tmp_path / name,
            rig=rig_file,
            duration_s=0.8,
            faults=timetable,
            form=PictureFormat.PNG if name == "one" else PictureFormat.LOSSLESS,
        )
        render_flight(request)
    taken = frames(tmp_path / "one")
    assert sorted(f.epoch for f in taken if f.station == "left") == [0, 1, 2, 3, 6, 7, 8]
    right = {f.epoch: f.image.whole() for f in taken if f.station == "right"}
    assert np.array_equal(right[5], right[8])
    assert not np.array_equal(right[4], right[5])
    cells = [row.split(",") for row in (tmp_path / "one" / "ptu.csv").read_text(encoding="utf-8").splitlines()[1:]]
    silent = [row for row in cells if 0.2 <= float(row[0]) < 0.4]
    assert silent
    assert all(row[3] == "" and row[1] != "" for row in silent)
    for table in ("frames.csv", "ptu.csv", "dgps.csv", "truth.csv"):
        assert (tmp_path / "one" / table).read_bytes() == (tmp_path / "two" / table).read_bytes()
    for one, two in zip(taken, frames(tmp_path / "two"), strict=True):
        assert np.array_equal(one.image.whole(), two.image.whole()), "a lossless video holds the same pixels"


@pytest.mark.parametrize(
    ("text", "reported"),
    [
        ('[[fault]]\nwhat = "camera_gone"\nfrom_s = 1', "fault 1: what: got 'camera_gone'"),
        ('[[fault]]\nwhat = "camera_lost"\nstation = "left"', "fault 1: from_s: got nothing"),
        ('[[fault]]\nwhat = "camera_lost"\nfrom_s = 1', "station: got ''"),
        ('[[fault]]\nwhat = "ptu_spike"\nstation = "left"\nfrom_s = 1\nby_s = 2', "by_deg: got nothing"),
        ('[[fault]]\nwhat = "camera_late"\nstation = "left"\nfrom_s = 1\nby_deg = 2', "wanted by_s"),
        ('[[fault]]\nwhat = "dgps_gap"\nfrom_s = 1\nuntil_s = 2', "until_s: got an unknown key"),
        ("fault = 3", "wanted [[fault]] tables"),
        ("[[fault]\n", "not TOML"),
    ],
)
def test_a_wrong_timetable_is_one_line(text: str, reported: str, tmp_path: Path) -> None:
    path = tmp_path / "faults.toml"
    path.write_text(text, encoding="utf-8")
    assert reported in complaint(ConfigError, lambda: load_faults(path))


def test_every_kind_of_fault_can_be_written(tmp_path: Path) -> None:
    size = {"ptu_spike": "by_deg = 0.5"}
    rows = []
    for kind in FaultKind:
        station = "" if kind.startswith("dgps") else 'station = "left"\n'
        by = size.get(kind, "by_s = 0.1" if kind.endswith(("late", "step")) else "")
        rows.append(f'[[fault]]\nwhat = "{kind}"\n{station}from_s = 1\n{by}\n')
    path = tmp_path / "faults.toml"
    path.write_text("".join(rows), encoding="utf-8")
    assert [f.kind for f in load_faults(path)] == list(FaultKind)


@pytest.mark.parametrize(
    "arguments",
    [
        ["--rate", "0"],
        ["--rate", "nan"],
        ["--duration", "-1"],
        ["--wind", "40"],
        ["--seed", "1.5"],
        ["--flight", "loop"],
        ["--pictures", "gif"],
    ],
)
def test_wrong_usage_is_2(arguments: Sequence[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        main(["simulate", "--out", str(tmp_path / "s"), *arguments])
    assert left.value.code == 2
    assert arguments[0] in capsys.readouterr().err


def test_what_cannot_be_is_one_line_and_1(rig_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    full = tmp_path / "full"
    full.mkdir()
    (full / "notes.txt").write_text("mine", encoding="utf-8")
    late = tmp_path / "late.toml"
    late.write_text(
        '[[fault]]\nwhat = "camera_clock_step"\nstation = "left"\nfrom_s = 0.2\nby_s = -0.15', encoding="utf-8"
    )
    out = str(tmp_path / "s")
    short = ["--rig", str(rig_file), "--duration", "0.5"]
    for arguments, reported in (
        (["--out", str(full), *short], "a folder that is not empty"),
        (["--out", str(full / "notes.txt"), *short], "got a file"),
        (["--out", out, "--rig", str(tmp_path / "none.toml")], "no such file"),
        (["--out", out, "--faults", str(tmp_path / "none.toml")], "no such file"),
        (["--out", out, "--faults", str(late), *short], "stamps that step back"),
    ):
        assert main(["simulate", *arguments]) == 1
        error = capsys.readouterr().err.splitlines()
        assert reported in error[-1]
        # refused before anything is begun: not even the folder is made
        assert not (tmp_path / "s").exists(), arguments
    assert (full / "notes.txt").read_text(encoding="utf-8") == "mine"
