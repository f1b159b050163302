"""A converted folder is like one that the devices recorded: their stamps and readings, and the rig to correct them."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from groundstation.cli.main import main
from groundstation.conversion.device_records import DeviceRecords
from groundstation.messages import Event, Frame, PtuSample
from groundstation.rig.ptu_axes import AxisCorrection, PtuAxes
from groundstation.rig.rig_toml import rig_to_toml
from groundstation.session import load_session
from groundstation.session.applied_axes import APPLIED_AXES
from groundstation.sources.session_source import session_source
from tests.recording.recorded import small_rig
from tests.session.folder import SESSION, Tiny, rig_text
from tests.sources.test_recorrection import AXES, recorded, replayed, rig_with, session_events

pytestmark = pytest.mark.usefixtures("unrendered_figures")

SMOOTH = "pan_zero_deg = 0.5, tilt_zero_deg = -0.2, pan_scale_ppm = 2000, pan_sine_deg = 0.05, tilt_sag_deg = 0.1"
OWN = {
    "left": f"ptu_axes = {{ {SMOOTH}, lean_deg = 0.1 }}\n"
    "ptu_clock = { offset_s = 0.02, drift_ppm = 30.0 }\ncamera_clock = { offset_s = -0.01 }"
}
OTHER = {
    "left": "ptu_axes = { pan_zero_deg = -0.3, tilt_scale_ppm = 900, pan_backlash_deg = 0.02 }\n"
    "ptu_clock = { offset_s = 0.1 }",
    "right": "ptu_axes = { tilt_zero_deg = 0.25 }",
}
WITH_BACKLASH = {"left": OWN["left"].replace("lean_deg", "pan_backlash_deg = 0.03, lean_deg"), "right": OTHER["right"]}
PACKINGS = pytest.mark.parametrize(
    "packing", [("packed.mcap",), ("bag", "--ros2")], ids=["by a recording", "by a ROS bag"]
)


def rig_file(path: Path, more: dict[str, str]) -> Path:
    path.write_text(rig_text(("left", "right"), (), more))
    return path


def converted(first: Path, packing: tuple[str, ...], *options: str) -> Path:
    packed, second = first.parent / packing[0], first.parent / "second"
    assert main(["convert", str(first), str(packed), *packing[1:]]) == 0
    assert main(["convert", str(packed), str(second), *options]) == 0
    return second


def by(path: Path, rig: Path | None = None) -> list[Event]:
    """The events of a session in order of time, by its own or another rig."""
    with session_source(load_session(path, rig)) as source:
        events = [event for event in source if isinstance(event, PtuSample | Frame)]
    return sorted(events, key=lambda e: (round(e.t_s, 7), type(e).__name__, e.station))


def require_same(events: list[Event], wanted: list[Event]) -> None:
    assert len(events) == len(wanted) > 30
    for one, two in zip(events, wanted, strict=True):
        assert isinstance(one, PtuSample | Frame)
        assert isinstance(two, PtuSample | Frame)
        assert (type(one), one.station) == (type(two), two.station)
        assert one.t_s == pytest.approx(two.t_s, abs=2e-9)
        if isinstance(one, PtuSample) and isinstance(two, PtuSample):
            assert (one.pan_rad, one.tilt_rad) == pytest.approx((two.pan_rad, two.tilt_rad), abs=1e-12)


@PACKINGS
def test_a_converted_folder_means_the_same_by_any_rig(tmp_path: Path, packing: tuple[str, ...]) -> None:
    """Expected: the rig byte for byte, and by it, by the same as --rig and by another, what the session gives."""
    first = Tiny(rows=8, video="png", rig_more=OWN).write(tmp_path / "first")
    second = converted(first, packing)
    assert (second / "rig.toml").read_bytes() == (first / "rig.toml").read_bytes()
    other, bare = rig_file(tmp_path / "other.toml", OTHER), rig_file(tmp_path / "bare.toml", {})
    for rig in (None, first / "rig.toml", other, bare):
        require_same(by(second, rig), by(first, rig))
        if packing[0].endswith(".mcap"):
            require_same(by(first.parent / packing[0], rig), by(first, rig))
    assert by(first, other) != by(first) != by(first, bare)


def test_a_bag_is_converted_by_another_rig_as_the_session_is_replayed(tmp_path: Path) -> None:
    """Expected: axes and clocks of --rig instead of those of the bag, not on top of them, and no others."""
    first = Tiny(rows=8, video="png", rig_more=OWN).write(tmp_path / "first")
    other = rig_file(tmp_path / "other.toml", OTHER)
    second = converted(first, ("bag", "--ros2"), "--rig", str(other))
    assert (second / "rig.toml").read_bytes() == other.read_bytes()
    require_same(by(second), by(first, other))


def test_a_bag_whose_angles_stay_takes_a_rig_of_the_same_axes_only(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Expected: with the axes of the session the same angles; with others a refusal, and no folder."""
    first = Tiny(rows=8, video="png", rig_more=WITH_BACKLASH).write(tmp_path / "first")
    second = converted(first, ("bag", "--ros2"), "--rig", str(first / "rig.toml"))
    require_same(by(second), by(first))
    other = rig_file(tmp_path / "other.toml", OTHER)
    assert main(["convert", str(tmp_path / "bag"), str(tmp_path / "third"), "--rig", str(other)]) == 1
    assert "other.toml: station left: ptu_axes: got other axes" in capsys.readouterr().err
    assert not (tmp_path / "third").exists()


def test_readings_of_a_recording_are_those_of_the_table(tmp_path: Path) -> None:
    """Expected: to the last bit, as a table of some digits has them, and so the angles."""
    first = Tiny(rows=8, video="png", rig_more=OWN).write(tmp_path / "first")
    second = converted(first, ("packed.mcap",))
    tables = [np.genfromtxt(f / "ptu.csv", delimiter=",", names=True) for f in (first, second)]
    for column in ("left_pan_deg", "left_tilt_deg", "right_pan_deg", "right_tilt_deg"):
        given, back = (table[column][np.isfinite(table[column])] for table in tables)
        np.testing.assert_array_equal(back, given[np.isin(given, back)])
        assert len(back) > 30


def test_the_inverse_is_exact_to_rounding(rng: np.random.Generator) -> None:
    """Expected: readings that make the same angles, for axes of all errors but a backlash, any way round."""
    left = small_rig()["left"]
    for _ in range(50):
        zeros, bent = rng.normal(0.0, 0.2, 2), rng.normal(0.0, 0.005, 5)
        axes = PtuAxes(
            pan_zero_rad=float(zeros[0]),
            tilt_zero_rad=float(zeros[1]),
            pan_scale=float(bent[0]),
            tilt_scale=float(bent[1]),
            pan_sine_rad=float(bent[2]),
            pan_cosine_rad=float(bent[3]),
            tilt_sag_rad=float(bent[4]),
        )
        devices, correction = DeviceRecords([replace(left, ptu_axes=axes)]), AxisCorrection(axes)
        assert not devices.kept
        for pan, tilt in rng.uniform(-math.pi, math.pi, (20, 2)).tolist():
            angles = correction.angles(pan, tilt)
            readings = [math.radians(deg) for deg in devices.readings_deg("left", *angles)]
            assert readings == pytest.approx([pan, tilt], abs=1e-12)
            assert correction.angles(*readings) == pytest.approx(angles, abs=1e-15 * (1 + math.hypot(*angles)))


@PACKINGS
def test_angles_whose_backlash_is_corrected_stay_and_are_not_corrected_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], packing: tuple[str, ...]
) -> None:
    """Expected: left's angles with what corrected them, right's readings; by a rig that is not theirs a refusal."""
    clocks = "\n[clocks]\nright = { offset_s = 0.125 }\n"
    first = Tiny(rows=8, video="png", rig_more=WITH_BACKLASH, session=SESSION + clocks).write(tmp_path / "first")
    second = converted(first, packing)
    assert "the angles of left are corrected by ptu_axes, whose backlash hides the readings" in capsys.readouterr().out
    given, own = load_session(first), load_session(second)
    assert own.rig["left"].ptu_axes == PtuAxes(lean_rad=own.rig["left"].ptu_axes.lean_rad)
    assert own.rig["left"].ptu_axes.lean_rad == pytest.approx(math.radians(0.1))
    assert own.rig["right"].ptu_axes == given.rig["right"].ptu_axes
    # clocks of the session are not written into the rig
    assert "camera_clock" not in (second / "rig.toml").read_text().split('name = "right"')[1]
    assert set(own.applied_axes) == {"left"}
    assert own.applied_axes["left"].pan_backlash_rad == pytest.approx(math.radians(0.03))
    require_same(by(second), by(first))
    # by the rig of operation, and by one without axes, the angles are the same; its clocks apply
    require_same(by(second, first / "rig.toml"), by(first))
    later = {name: text.replace("offset_s = 0.02", "offset_s = 0.12") for name, text in WITH_BACKLASH.items()}
    other = rig_file(tmp_path / "later.toml", later)
    require_same(by(second, other), by(first, other))
    rig_file(tmp_path / "other.toml", OTHER)
    capsys.readouterr()
    out = ["--out", str(tmp_path / "out"), "--no-rerun"]
    assert main(["replay", str(second), "--rig", str(tmp_path / "other.toml"), *out]) == 1
    told = capsys.readouterr().err.splitlines()[-1]
    assert "other.toml: station left: ptu_axes: got other axes than the session's angles are corrected by" in told
    assert told.endswith("wanted those, or none")


def test_what_is_applied_goes_with_a_recording_of_the_folder(tmp_path: Path) -> None:
    """Expected: packed, bagged and unpacked again the angles are the same, by the rig of operation, too."""
    first = Tiny(rows=8, video="png", rig_more=WITH_BACKLASH).write(tmp_path / "first")
    second = converted(first, ("packed.mcap",))
    again = tmp_path / "again"
    again.mkdir()
    for packing in (("again.mcap",), ("bag", "--ros2")):
        packed, third = again / packing[0], again / f"of-{packing[0].split('.')[0]}"
        assert main(["convert", str(second), str(packed), *packing[1:]]) == 0
        assert main(["convert", str(packed), str(third)]) == 0
        for rig in (None, first / "rig.toml"):
            require_same(by(third, rig), by(first))
        assert (third / "session.toml").read_text().count(f"[{APPLIED_AXES}.") == 1
    require_same(by(again / "again.mcap", first / "rig.toml"), by(first))
    # a replay by the rig of operation records that rig: its axes are not applied by it either
    out = ["--out", str(tmp_path / "out"), "--no-rerun", "--record", str(again / "replayed.mcap")]
    assert main(["replay", str(second), "--rig", str(first / "rig.toml"), *out]) == 0
    assert main(["convert", str(again / "replayed.mcap"), str(again / "of-replayed")]) == 0
    for rig in (None, first / "rig.toml"):
        require_same(by(again / "of-replayed", rig), by(first))


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ("[ptu_axes_applied.tower]\npan_zero_deg = 1.0", "got 'tower'; wanted a station (left, right)"),
        ("[ptu_axes_applied.left]\npan_zero = 1.0", "pan_zero"),
        ("[ptu_axes_applied]\nleft = 3", "left"),
    ],
)
def test_a_table_of_applied_axes_that_cannot_be(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], table: str, words: str
) -> None:
    first = Tiny(rows=3, video="png", session=f"{SESSION}\n{table}\n").write(tmp_path / "first")
    assert main(["convert", str(first), str(tmp_path / "packed.mcap")]) == 1
    assert words in capsys.readouterr().err


# ---------------------------------------------------------------------------------- early recordings of operation
@pytest.fixture
def early(tmp_path: Path) -> Path:
    """A recording whose events its rig, with axes and clocks, has not corrected."""
    rig = rig_with(replace(AXES, pan_backlash_rad=1e-3), -0.037, 0.012)
    (tmp_path / "own.toml").write_text(rig_to_toml(rig))
    return recorded(tmp_path, rig, session_events(small_rig()), corrected=False)


def readings(events: list[Event]) -> list[PtuSample]:
    found = [event for event in events if isinstance(event, PtuSample)]
    return sorted(found, key=lambda e: (round(e.t_s, 7), e.station))


@PACKINGS
def test_a_folder_of_an_early_recording_has_its_readings(
    early: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], packing: tuple[str, ...]
) -> None:
    """Expected: its rig with the axes, which correct the folder once, as --rig does the recording."""
    folder = tmp_path / "folder"
    if packing[1:]:
        assert main(["convert", str(early), str(tmp_path / "bag"), "--ros2"]) == 0
        assert main(["convert", str(tmp_path / "bag"), str(folder)]) == 0
    else:
        assert main(["convert", str(early), str(folder)]) == 0
        told = capsys.readouterr().out
        assert "note: the recording has readings and stamps that no axes or clocks have corrected" in told
        assert (folder / "rig.toml").read_bytes() == (tmp_path / "own.toml").read_bytes()
        table = np.genfromtxt(folder / "ptu.csv", delimiter=",", names=True)
        raw = [event for event in readings(session_events(small_rig())) if event.station == "left"]
        there = np.isfinite(table["left_pan_deg"])
        np.testing.assert_array_equal(table["t_s"][there], [event.t_s for event in raw])
        angles = np.radians(table["left_pan_deg"][there])
        np.testing.assert_allclose(angles, [event.pan_rad for event in raw], rtol=0.0, atol=1e-15)
    wanted = readings(replayed(early, tmp_path / "own.toml"))
    for one, two in zip(readings(by(folder)), wanted, strict=True):
        assert one.t_s == pytest.approx(two.t_s, abs=2e-9)
        assert (one.pan_rad, one.tilt_rad) == pytest.approx((two.pan_rad, two.tilt_rad), abs=1e-12)


def test_a_bag_of_an_earlier_version_is_read_as_it_was(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Expected: by its own rig, that of its angles, as ever; axes of --rig are noted: they may be in them already."""
    first = Tiny(rows=8, video="png", rig_more=OWN).write(tmp_path / "first")
    bag = tmp_path / "bag"
    assert main(["convert", str(first), str(bag), "--ros2"]) == 0
    metadata = bag / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("groundstation/device_rig.toml", "another/thing"))
    capsys.readouterr()
    assert main(["convert", str(bag), str(tmp_path / "second")]) == 0
    assert "note" not in capsys.readouterr().out
    require_same(by(tmp_path / "second"), by(first))
    assert main(["convert", str(bag), str(tmp_path / "third"), "--rig", str(first / "rig.toml")]) == 0
    told = capsys.readouterr().out
    assert (
        "note: the bag is of an earlier version, whose angles of left are corrected already if its session had" in told
    )
