"""The table of sightings as it grows, the list to record, the mark in further pictures, and the pictures' folder."""

import errno
import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from calibration.landmarks.mark_pictures import MarkPictures
from calibration.landmarks.mark_registration import (
    MarkReference,
    NoRegisteredMark,
    RegisteredMark,
    register_mark,
    row_sigmas,
)
from calibration.landmarks.sighting_list import read_sighting_list
from calibration.landmarks.sighting_table import SightingTable
from calibration.sightings import LandmarkSighting, read_sightings
from groundstation.errors import InputError
from tests.calibration.landmarks.sighting_set_up import SIZE, scene

# printable and not at the ends of spaces, as tables of landmarks and rig files let through
visible = st.characters(categories=("L", "Nd", "P", "S"))
names = st.one_of(visible, st.builds("{}{}{}".format, visible, st.text(visible | st.just(" "), max_size=9), visible))
sightings = st.builds(
    LandmarkSighting,
    station=names,
    landmark=names,
    pan_rad=st.floats(-12.0, 12.0),
    tilt_rad=st.floats(-3.0, 3.0),
    pixel_px=st.tuples(st.floats(0.0, 4000.0), st.floats(0.0, 4000.0)).map(np.array),
    sigma_px=st.floats(0.01, 100.0),
    t_s=st.none() | st.floats(0.0, 4e9),
    pan_from=st.sampled_from((-1, 1)),
    tilt_from=st.sampled_from((-1, 1)),
    line=st.just(0),
)


def sighting(landmark: str, pan_deg: float = 1.0) -> LandmarkSighting:
    return LandmarkSighting(
        station="left",
        landmark=landmark,
        pan_rad=float(np.radians(pan_deg)),
        tilt_rad=0.1,
        pixel_px=np.array([80.0, 60.0]),
        sigma_px=0.3,
        t_s=1.0,
        pan_from=1,
        tilt_from=-1,
        line=0,
    )


@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(stops=st.lists(st.lists(sightings, min_size=1, max_size=3), min_size=1, max_size=3))
def test_rows_are_read_as_they_were_taken(tmp_path: Path, stops: list[list[LandmarkSighting]]) -> None:
    """Expected: names as given, numbers to the table's last digit, whatever the names hold."""
    path = tmp_path / "sightings.csv"
    path.unlink(missing_ok=True)
    for rows in stops:
        # opened again for each, as after an interrupt
        SightingTable(path).append(rows)
    taken = [row for rows in stops for row in rows]
    for got, wanted in zip(read_sightings(path), taken, strict=True):
        assert (got.station, got.landmark) == (wanted.station, wanted.landmark)
        assert (got.pan_from, got.tilt_from) == (wanted.pan_from, wanted.tilt_from)
        assert (got.pan_rad, got.tilt_rad) == pytest.approx((wanted.pan_rad, wanted.tilt_rad), abs=1e-8)
        assert got.pixel_px == pytest.approx(wanted.pixel_px, abs=6e-5)
        assert got.sigma_px == pytest.approx(wanted.sigma_px, abs=6e-5)
        assert (got.t_s is None) == (wanted.t_s is None)


@pytest.mark.parametrize("fault", [OSError(errno.ENOSPC, "No space left on device"), KeyboardInterrupt()])
def test_a_stop_that_is_cut_off_leaves_no_part(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fault: BaseException
) -> None:
    """Expected: after a full disk or an interrupt in the middle of a stop's rows the file is as before."""
    path = tmp_path / "sightings.csv"
    table = SightingTable(path)
    table.append([sighting("mast")])
    before = path.read_bytes()
    write = os.write

    def cut(descriptor: int, data: bytes) -> int:
        if len(data) < 60:
            raise fault
        return write(descriptor, data[:-50])

    monkeypatch.setattr(os, "write", cut)
    with pytest.raises(type(fault)) as told:
        table.append([sighting("shed")] * 3)
    monkeypatch.undo()
    assert path.read_bytes() == before
    assert table.rows_of("left", "shed") == 0
    if isinstance(fault, OSError):
        assert str(path) in str(told.value)


def test_where_a_landmark_was_seen_is_the_median(tmp_path: Path) -> None:
    table = SightingTable(tmp_path / "s.csv")
    assert table.angles_of("left", "mast") is None
    table.append([sighting("mast", pan) for pan in (1.0, 1.1, 9.0)])
    assert table.angles_of("left", "mast") == pytest.approx([np.radians(1.1), 0.1])
    assert table.angles_of("right", "mast") is None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a,b\n", "line 1: got the columns a,b; wanted station,landmark"),
        ("\n", "line 1: got no columns"),
        ("HEADER\nleft,mast,1,2,3,4,0.3,1", "got a last line without an end"),
        ("HEADER\nleft,mast,1,2,3\n", "line 2: got 5 cells; wanted 10"),
    ],
)
def test_a_table_that_takes_no_row_is_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "old.csv"
    SightingTable(path).append([sighting("mast")])
    header = path.read_text(encoding="utf-8").splitlines()[0]
    path.write_text(text.replace("HEADER", header), encoding="utf-8")
    with pytest.raises(InputError, match=message):
        SightingTable(path)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ("", "got no row"),
        ("oak,1,2,,", "line 2: got landmark 'oak'; wanted one of the table of landmarks"),
        ("mast,721,2,,", "pan_deg = 721; wanted a number from -720 to 720"),
        ("mast,1,2,5,", "got one of u_px, v_px"),
        ("mast,1,nan,5,5", "tilt_deg = 'nan'"),
    ],
)
def test_a_list_at_fault_is_refused(tmp_path: Path, rows: str, message: str) -> None:
    path = tmp_path / "list.csv"
    path.write_text(f"landmark,pan_deg,tilt_deg,u_px,v_px\n{rows}\n", encoding="utf-8")
    with pytest.raises(InputError, match=message):
        read_sighting_list(path, {"mast"})


def test_a_mark_is_followed_to_a_tenth_of_a_pixel() -> None:
    """Expected: a scene moved by tens of pixels is found, with a sigma near the error."""
    mark = np.array([80.0, 60.0])
    reference = MarkReference(image=scene(np.zeros(2), mark), pixel_px=mark)
    for shift in ((0.3, -0.4), (21.6, -11.2), (-30.5, 14.25)):
        found = register_mark(reference, scene(np.array(shift), mark))
        assert isinstance(found, RegisteredMark)
        assert found.pixel_px == pytest.approx(mark + shift, abs=0.1)
        assert found.sigma_px < 0.1


def test_a_mark_that_is_not_there_is_not_found() -> None:
    """Expected: each way of finding nothing has its reason."""
    generator, mark = np.random.default_rng(5), np.array([80.0, 60.0])
    picture = scene(np.zeros(2), mark)
    reference = MarkReference(image=picture, pixel_px=mark)

    def reason(of: MarkReference, image: np.ndarray) -> str:
        found = register_mark(of, image)
        assert isinstance(found, NoRegisteredMark)
        return found.reason

    even = np.full_like(picture, 90)
    noise = generator.integers(0, 255, picture.shape, dtype=np.uint8)
    assert reason(MarkReference(image=even, pixel_px=mark), picture) == "nothing but an even area around it"
    assert reason(reference, noise) == "not in the picture, or it looks different now"
    assert reason(reference, picture[:-2]) == "its reference is another camera's picture"
    posts = np.zeros((400, 600, 3), np.uint8)
    posts[:, ::20] = 200
    posts[::20] = 200
    assert reason(MarkReference(image=posts, pixel_px=np.array([300.0, 200.0])), posts) == "several places look alike"
    edge = np.zeros((120, 160, 3), np.uint8)
    edge[:, 80:] = 200
    edge += generator.integers(0, 20, edge.shape, dtype=np.uint8)
    assert reason(MarkReference(image=edge, pixel_px=mark), edge) in (
        "several places look alike",
        "too little texture around it to tell its place",
    )


def test_the_sigma_of_a_stop_is_that_of_its_picked_pixel() -> None:
    """Expected: a weighted mean of n rows is as uncertain as the pixel they share, and their own errors averaged."""
    sigmas = np.array(row_sigmas([0.1] * 40, 0.3))
    assert 1.0 / np.sum(sigmas**-2.0) == pytest.approx(0.3**2 + 0.1**2 / 40)


def test_a_picture_that_was_changed_is_no_reference(tmp_path: Path) -> None:
    """Expected: a mark is known again after a new start, not once its file is another one; names stay in the folder."""
    mark = np.array([80.25, 60.5])
    reference = MarkReference(image=scene(np.zeros(2), mark), pixel_px=mark)
    path = MarkPictures(tmp_path, "left", SIZE, ["mast"]).keep("mast", reference)
    known = MarkPictures(tmp_path, "left", SIZE, ["mast"]).reference("mast")
    assert known is not None
    assert np.array_equal(known.image, reference.image)
    assert np.array_equal(known.pixel_px, mark)
    assert MarkPictures(tmp_path, "right", SIZE, ["mast"]).reference("mast") is None
    assert MarkPictures(tmp_path, "left", (640, 480), ["mast"]).reference("mast") is None
    path.write_bytes(path.read_bytes()[:-1] + b"x")
    assert MarkPictures(tmp_path, "left", SIZE, ["mast"]).reference("mast") is None
    with pytest.raises(InputError, match=r"the name '../mast.png'"):
        MarkPictures(tmp_path, "left", SIZE, ["../mast"])
