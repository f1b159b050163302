"""A rendered approach of a few pictures, made once."""

from collections.abc import Iterator
from functools import cache

import numpy as np

from groundstation.arrays import ImageArray
from groundstation.onboard.edges.pose import Attitude, NoseCameraPose, nose_pose
from groundstation.onboard.fly import series_of
from groundstation.onboard.pose.agreement import PositionTrack
from groundstation.onboard.scenes.nose_flight import (
    CAMERA_PITCH_DEG,
    NoseFlight,
    navigation_poses,
    nose_flight,
    nose_setup,
)
from groundstation.onboard.scenes.sequences import SEQUENCES
from groundstation.onboard.visual_inertial.nose_navigator import NoseNavigator

FRAMES = 24


@cache
def night_flight() -> tuple[NoseFlight, list[ImageArray]]:
    """Return the first pictures of a flight by night from 150 m on."""
    flight = nose_flight(SEQUENCES[3], nose_setup(SEQUENCES[3], 1.4, from_m=150.0))
    return flight, [picture for _, picture in flight.pictures()]


@cache
def short_flight() -> tuple[NoseFlight, list[ImageArray]]:
    """Return a flight by day from 200 m before the threshold on, and its pictures."""
    flight = nose_flight(SEQUENCES[0], nose_setup(SEQUENCES[0], FRAMES / 10.0, from_m=200.0))
    return flight, [picture for _, picture in flight.pictures()]


def given_to(
    navigator: NoseNavigator, flight: NoseFlight, pictures: list[ImageArray]
) -> Iterator[tuple[float, ImageArray, NoseCameraPose]]:
    """Yield the time, the picture and the navigation's pose of each picture, the inertial samples having been taken."""
    attitude, place = navigation_poses(flight, np.random.default_rng(5))
    mount = Attitude(pitch_rad=float(np.radians(CAMERA_PITCH_DEG)))
    fed = 0
    for sample, picture in zip(flight.frames, pictures, strict=True):
        while fed <= sample:
            navigator.process_imu(flight.motion.samples[fed])
            fed += 1
        roll, pitch, yaw = (float(a) for a in attitude[sample])
        reported = nose_pose(place[sample], Attitude(roll_rad=roll, pitch_rad=pitch, yaw_rad=yaw), mount)
        yield float(flight.motion.t_s[sample]), picture, reported


def ground_series(flight: NoseFlight, pictures: list[ImageArray]) -> PositionTrack:
    """Return the aircraft's own positions of the flight."""
    navigator = NoseNavigator(flight.runway, flight.setup.lens, flight.setup.mount)
    fixes = [navigator.update(*given).fix for given in given_to(navigator, flight, pictures)]
    return series_of([fix for fix in fixes if fix is not None])
