"""Head angles from pictures of a rolling shutter while the head turns: each row is exposed at its own time."""

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest

from calibration.panorama.calibrate import _rates_at
from calibration.panorama.mosaic import Mosaic, PanoramaFrame, make_mosaic
from groundstation.arrays import FloatArray, ImageArray
from groundstation.geometry.rolling_shutter import row_delay_s
from groundstation.messages import Event, Frame, PtuSample
from groundstation.picture import as_picture
from groundstation.registration.head_registration import STANDING, HeadRegistration, RegisteredAngles
from groundstation.registration.panorama import GroundPanorama, halved_grey
from groundstation.rig.rig import Rig, Station
from groundstation.tracking.config import Config
from groundstation.tracking.pipeline import Pipeline
from groundstation.tracking.registered_heads import RegisteredHeads
from tests.simulation.small_site import small_rig

SIZE = (480, 360)
READOUT_S = 0.02
STEP_RAD = 1.0 / 900.0
NOISE_RAD = float(np.radians(0.02))
# of the base: ground from its level down, as an operator's site has it
TRUE = np.radians([1.0, 0.0])


def station(readout_s: float) -> Station:
    one = small_rig(focal_px=1800.0, size_px=SIZE).stations[0]
    level = np.array([1.0, 0.0, 0.0, 0.0])
    return replace(
        one, ptu_resolution_rad=0.0, ptu_sigma_rad=NOISE_RAD, readout_s=readout_s, runway_from_base_wxyz=level
    )


@cache
def ground() -> GroundPanorama:
    random = np.random.default_rng(40)
    grey = cv2.GaussianBlur(random.normal(0.0, 1.0, (260, 900)), (0, 0), 2.0)
    grey = np.clip(115.0 + 32.0 * grey / grey.std(), 0.0, 255.0).astype(np.float32)
    known = np.ones(grey.shape, dtype=np.uint8)
    return GroundPanorama(grey=grey, known=known, left_rad=450.0 * STEP_RAD, top_rad=0.0, step_rad=STEP_RAD)


def picture(one: Station, angles_rad: FloatArray, rates_rad_s: FloatArray) -> FloatArray:
    """Return `whole_picture`, halved."""
    return halved_grey(whole_picture(one, angles_rad, rates_rad_s))


def whole_picture(one: Station, angles_rad: FloatArray, rates_rad_s: FloatArray) -> ImageArray:
    """Return what a camera shows of the ground, (h, w): each row by the pinhole chain at its own exposure's angles."""
    (w, h), lens, place = SIZE, one.lens, ground()
    image = np.full((h, w), 150.0, dtype=np.float32)
    x = (np.arange(w) - lens.principal_point_px[0]) / lens.focal_px[0]
    for v in range(h):
        y = (v - lens.principal_point_px[1]) / lens.focal_px[1]
        pan, tilt = angles_rad + float(row_delay_s(float(v), h, one.readout_s)) * rates_rad_s
        rays = np.column_stack([x, np.full(w, y), np.ones(w)])
        towards = rays @ one.geometry().camera_pose(float(pan), float(tilt)).runway_from_camera.T
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        right = (place.left_rad - np.arctan2(-towards[:, 0], towards[:, 1])) / STEP_RAD
        down = (place.top_rad - np.arcsin(towards[:, 2])) / STEP_RAD
        at = (np.asarray(c, dtype=np.float32)[None] for c in (right, down))
        image[v] = cv2.remap(place.grey, *at, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=150.0)[0]
    return np.asarray(np.clip(image, 0, 255), dtype=np.uint8)


@pytest.mark.parametrize("known", [True, False], ids=["rates known", "rates unknown"])
@pytest.mark.parametrize("readout_s", [READOUT_S, -READOUT_S])
@pytest.mark.parametrize("rates_deg_s", [(0.0, 0.0), (5.0, 0.0), (-3.0, 2.0)])
def test_the_angles_are_those_of_the_rows_that_tell(
    rates_deg_s: tuple[float, float], readout_s: float, known: bool
) -> None:
    """Expected: those of the instant that is said, as well as a standing head's, after the stamp if rows go downwards.

    Until rows had times of their own a turn of 5 °/s was an error of 0.025° at a sigma of 0.002°.
    """
    one, rates = station(readout_s), np.radians(rates_deg_s)
    told = (float(rates[0]), float(rates[1])) if known else STANDING
    start = (*(TRUE + np.radians([0.008, -0.006])).tolist(), NOISE_RAD)
    head = HeadRegistration(one, ground())
    found = head.register_grey(picture(one, TRUE, rates), *start, told)
    still = head.register_grey(picture(one, TRUE, np.zeros(2)), *start)
    assert isinstance(found, RegisteredAngles)
    assert isinstance(still, RegisteredAngles)
    assert 0.15 < found.delay_s / readout_s < 0.4
    off = np.array([found.pan_rad, found.tilt_rad]) - (TRUE + found.delay_s * rates)
    # what the drawing is off by is not the rows'
    off -= np.array([still.pan_rad, still.tilt_rad]) - TRUE
    assert np.abs(off).max() < 0.4 * found.sigma_rad
    # what the stamp's angles would be off by
    assert not rates.any() or np.abs(found.delay_s * rates).max() > 3.0 * found.sigma_rad


@cache
def mosaic(turning: bool) -> Mosaic:
    """Return the panorama of a head that turned to and fro, as it is made knowing that, or as one that stood."""
    one, random, frames = station(READOUT_S), np.random.default_rng(41), []
    for k, pan in enumerate(np.linspace(-4.0, 4.0, 9)):
        angles, rates = np.radians([pan, 0.0]), np.radians([8.0 if k % 2 else 3.0, 0.0])
        noisy = angles + random.normal(0.0, 0.1 * NOISE_RAD, 2)
        told = (float(rates[0]), float(rates[1])) if turning else STANDING
        frames.append(PanoramaFrame(grey=picture(one, angles, rates), angles_rad=noisy, rates_rad_s=told))
    return make_mosaic(replace(one, ptu_sigma_rad=0.1 * NOISE_RAD), frames, np.radians(1.0))


@pytest.mark.parametrize("turning", [True, False])
def test_a_panorama_of_a_turning_head_is_where_the_ground_is(turning: bool) -> None:
    """Expected: a standing frame is found where the head stands, to the encoders' sigma; not without the rates."""
    one, made = station(READOUT_S), mosaic(turning).panorama
    grey = picture(one, TRUE, np.zeros(2))
    found = HeadRegistration(one, made).register_grey(grey, *TRUE.tolist(), NOISE_RAD)
    assert isinstance(found, RegisteredAngles)
    off = np.abs(np.array([found.pan_rad, found.tilt_rad]) - TRUE).max()
    assert (off < 3.0 * found.sigma_rad) == turning, (np.degrees(off), np.degrees(found.sigma_rad))


def test_rates_of_frames_are_those_of_the_readings_around_them() -> None:
    """Expected: of steps of 0.01° at 50 Hz to 0.05 °/s, across half a turn, and at both ends of the readings."""
    t_s = np.arange(0.0, 4.0, 0.02)
    pan = np.radians(178.0 + 5.0 * t_s)
    steps = np.radians(0.01) * np.round(pan / np.radians(0.01))
    readings = np.column_stack([t_s, np.angle(np.exp(1j * steps)), np.radians(-2.0 * t_s)])
    found = np.degrees(_rates_at(np.array([0.0, 0.35, 0.4, 2.0, 3.98]), readings))
    np.testing.assert_allclose(found[:, 0], 5.0, atol=0.11)
    np.testing.assert_allclose(found[:, 1], -2.0, atol=1e-9)
    # frames without readings around them have no rate to tell
    np.testing.assert_array_equal(_rates_at(np.array([9.0]), readings), 0.0)


def test_frames_of_a_turning_head_have_the_angles_of_their_stamps() -> None:
    """Expected: pan of each frame to its sigma, between readings ten times as noisy; 0.024° off by the rows' time."""
    random, rate = np.random.default_rng(42), np.radians([5.0, 0.0])
    one = station(READOUT_S)
    heads = RegisteredHeads(Rig(stations=(one,)), {one.name: ground()})
    pipeline = Pipeline(Rig(stations=(one,)), Config(), heads=heads)
    events: list[Event] = []
    for k in range(60):
        t_s = 0.01 * k
        pan, tilt = (np.radians([-1.0, 0.0]) + t_s * rate + random.normal(0.0, NOISE_RAD, 2)).tolist()
        events.append(PtuSample(t_s=t_s, station=one.name, pan_rad=pan, tilt_rad=tilt))
    for k in range(15):
        t_s = 0.105 + k / 30.0
        image = np.repeat(whole_picture(one, np.radians([-1.0, 0.0]) + t_s * rate, rate)[:, :, None], 3, axis=2)
        events.append(Frame(t_s=t_s, station=one.name, epoch=k, image=as_picture(image)))
    events.sort(key=lambda event: event.t_s)
    reports = [*map(pipeline.step, events), pipeline.finish()]
    seen = [camera for report in reports for camera in report.cameras]
    assert len(seen) == 15
    assert heads.notes() == [f"head angles of {one.name} from the picture in 15 of 15 frames"]
    off = [np.degrees((c.pan_rad or 0.0) - np.radians(-1.0) - c.t_s * rate[0]) for c in seen]
    assert abs(np.mean(off)) < 0.002, off
    assert np.std(off) < 0.25 * np.degrees(NOISE_RAD)
