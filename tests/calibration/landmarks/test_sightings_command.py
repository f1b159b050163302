"""`groundstation calibrate sightings`: by a list and by a dialogue, on simulated units and videos as cameras."""

import builtins
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from landmark_study.simulated import turned_rad
from scipy.stats import chi2

from calibration.sightings import read_sightings
from groundstation.cli.main import main
from groundstation.live import guarded_head
from groundstation.rig.rig import Rig, load_rig
from groundstation.rig.rig_toml import rig_to_toml
from ptu_drivers.interface import PanTiltUnit
from ptu_drivers.messages import Axis
from ptu_drivers.simulated.server import SimulatedServer
from tests.calibration.landmarks.sighting_set_up import (
    PLACES_M,
    aims,
    brisk_unit,
    mark_px,
    shifts,
    true_rig,
    write_landmarks,
    write_station,
)
from tests.live.test_heads import pan_of, pan_rate_of, until

ROWS = 3
NORTH_WXYZ = np.array([1.0, 0.0, 0.0, 0.0])


@dataclass(frozen=True)
class Field:
    """The station's folder, its rig, and the server of the left unit."""

    folder: Path
    rig: Rig
    left: SimulatedServer

    def arguments(self, name: str, out: Path, *more: str) -> list[str]:
        landmarks = str(self.folder / "landmarks.csv")
        given = ["--landmarks", landmarks, "--out", str(out), "--rows", str(ROWS), "--rate", "50"]
        return ["calibrate", "sightings", str(self.folder / "field.toml"), name, *given, *more]


@pytest.fixture(scope="module")
def field(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Field]:
    folder, rig = tmp_path_factory.mktemp("field"), true_rig()
    write_station(folder, rig)
    write_landmarks(folder / "landmarks.csv")
    with ExitStack() as stack:
        left, _ = (stack.enter_context(brisk_unit(folder / s.name)) for s in rig.stations)
        yield Field(folder, rig, left)


def type_lines(monkeypatch: pytest.MonkeyPatch, lines: Sequence[str]) -> None:
    """Let a user type these lines, then Ctrl-D."""
    typed = iter(lines)

    def ask(_: str) -> str:
        try:
            return next(typed)
        except StopIteration:
            raise EOFError from None

    monkeypatch.setattr(builtins, "input", ask)


def test_what_a_list_records_surveys_the_station(
    field: Field, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Expected: rows that cannot be recorded are told (exit code 1); by the others survey finds the true rig."""
    out, listed = tmp_path / "sightings.csv", tmp_path / "list.csv"
    left, right = field.rig.stations
    u, v = mark_px(left)
    rows = [f"{name},{pan:.4f},{tilt:.4f},{u:g},{v:g}" for name, (pan, tilt) in aims(left).items()]
    text = ["landmark,pan_deg,tilt_deg,u_px,v_px", "mast,300,0,80,60", "hut,1,0,,", *rows]
    listed.write_text("\n".join(text) + "\n", encoding="utf-8")
    assert main(field.arguments("left", out, "--from", str(listed))) == 1
    told = capsys.readouterr()
    assert "the upper limit is 169" in told.err
    assert "hut: got no earlier picture of it" in told.err
    assert told.out.splitlines()[-1] == f"{len(PLACES_M)} of {len(PLACES_M) + 2} stops saved"
    seen = read_sightings(out)
    assert len(seen) == len(PLACES_M) * ROWS
    assert all(s.t_s is not None and s.pan_from and s.tilt_from for s in seen)
    with out.open("a", encoding="utf-8") as stream:
        u, v = right.lens.principal_point_px
        stream.writelines(f"right,{name},{p},{t},{u},{v},0.3,,,\n" for name, (p, t) in aims(right).items())
    # the scene's own motion since the frame for which the pixel was stated, whichever that was
    moves = np.array([s.pixel_px for s in seen[:ROWS]]) - mark_px(left)
    since = shifts()[None] - shifts()[:, None]
    apart = np.linalg.norm(moves[:, None, None] - since[None], axis=3).min(axis=2)
    # two cubic interpolations and eight bits of grey
    assert apart.max(axis=0).min() < 0.1
    unknown = (replace(s, known=("position", "lens"), runway_from_base_wxyz=NORTH_WXYZ) for s in field.rig.stations)
    stated = tmp_path / "stated.toml"
    stated.write_text(rig_to_toml(Rig(stations=tuple(unknown))), encoding="utf-8")
    landmarks = str(field.folder / "landmarks.csv")
    assert main(["calibrate", "survey", str(out), "--landmarks", landmarks, "--rig", str(stated)] + _out(tmp_path)) == 0
    found = load_rig(tmp_path / "found.toml")
    turned, covariance = turned_rad(found["left"], left), found.calibration_covariance()
    own = [covariance.names.index(f"left.runway_from_base.{axis}") for axis in "xyz"]
    assert turned @ np.linalg.solve(covariance.matrix[np.ix_(own, own)], turned) < chi2.ppf(0.999, 3)


def _out(folder: Path) -> list[str]:
    return ["--out", str(folder / "found.toml")]


def test_a_dialogue_turns_looks_records_and_goes_on(
    field: Field, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Expected: faults are told and change nothing; a stop is saved; the next start continues, and finds the mark."""
    out = tmp_path / "today.csv"
    u, v = mark_px(field.rig["left"])
    type_lines(
        monkeypatch,
        ["300 0", "nonsense", "at 500 3", "same", "go", "\x1b[C\x1b[C\x1b[A", "look", f"at {u:g} {v:g}", "list", "end"],
    )
    assert main(field.arguments("left", out)) == 0
    reported = capsys.readouterr().out
    for part in (
        "mast: 0 rows; expected at pan +6.811, tilt +1.924 deg, by the rig",
        "the upper limit is 169",
        "the line: got 'nonsense'; wanted 2 numbers",
        "mast: got pixel 500 3; wanted one in the picture of 160 × 120 px",
        "mast: got no earlier picture of it",
        f"mast: saved {ROWS} rows: pan +6.6125, tilt +2.0250 deg",
        "1 of 3 landmarks recorded",
        f"1 stop saved to {out}",
    ):
        assert part in reported
    pictures = tmp_path / "today.pictures" / "left"
    assert {p.relative_to(pictures).as_posix() for p in pictures.rglob("*.*")} == {
        "marks.csv",
        "marks/mast.png",
        "looks/mast.png",
        "crops/mast.png",
    }
    type_lines(monkeypatch, ["next mast", "5 1", "look", "same", "next shed", "at 83 57"])
    assert main(field.arguments("left", out)) == 0
    reported = capsys.readouterr().out
    # the first landmark without rows comes first
    assert "shed: 0 rows; expected" in reported
    assert (
        f"mast: {ROWS} rows; expected at pan +6.612, tilt +2.025 deg, as it was seen before: go, then look or same"
        in (reported)
    )
    assert f"by its earlier picture the mark is at {u:.2f} {v:.2f} px" in reported
    # it is recorded all the same: the rig may be wrong
    assert "shed: is it this one? By the rig it is 23.8 deg from where the head points" in reported
    assert "mast: is it this one?" not in reported
    seen = read_sightings(out)[: 2 * ROWS]
    assert {s.landmark for s in seen} == {"mast"}
    assert np.abs(np.array([s.pixel_px for s in seen]) - (u, v)).max() <= np.abs(shifts()).max() + 0.05
    assert (pan_of(field.left, 1e9), seen[-1].pan_rad) == pytest.approx([np.radians(5.0)] * 2, abs=1e-4)


def test_an_interrupted_turn_is_halted(field: Field, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: on Ctrl-C on the way to a target, exit code 130 and a head that stands."""

    def interrupted(unit: PanTiltUnit, targets_rad: dict[Axis, float], *_: object) -> None:
        unit.move_to(pan_rad=targets_rad[Axis.PAN], rate_rad_s=np.radians(8.0))
        assert until(lambda: abs(pan_rate_of(field.left)) > np.radians(4.0))
        raise KeyboardInterrupt

    monkeypatch.setattr(guarded_head, "move", interrupted)
    type_lines(monkeypatch, [f"{far_pan_deg(field):g} 0"])
    assert main(field.arguments("left", tmp_path / "none.csv")) == 130
    assert until(lambda: pan_rate_of(field.left) == 0.0, 1.0)


def test_the_head_stands_where_the_program_is_killed(field: Field, tmp_path: Path) -> None:
    """Expected: the motion guard halts it, long before its target."""
    command = [sys.executable, "-m", "groundstation", *field.arguments("left", tmp_path / "none.csv")]
    command[command.index("--rate") + 1] = "8"
    target_deg = far_pan_deg(field)
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as process:
        assert process.stdin is not None
        process.stdin.write(f"{target_deg:g} 0\n")
        process.stdin.flush()
        assert until(lambda: abs(pan_rate_of(field.left)) > np.radians(4.0), 60.0)
        process.kill()
    assert until(lambda: pan_rate_of(field.left) == 0.0, 6.0)
    # 100 deg and more at 8 deg/s are 12 s
    assert abs(np.degrees(pan_of(field.left, 1e9)) - target_deg) > 20.0


def far_pan_deg(field: Field) -> float:
    """Return a pan that is more than 100 deg away."""
    return -100.0 if pan_of(field.left, 1e9) > 0.0 else 100.0
