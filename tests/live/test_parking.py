"""The heads at the end: one that is not at its commanded position, or does not report it, is named."""

import math

import pytest

from groundstation.live.core import LiveCore
from groundstation.live.frame_pairing import FramePairer
from groundstation.messages import PtuSample
from groundstation.pointing.head_limits import AxisLimits, HeadLimits
from groundstation.pointing.pointing_law import HeadController, PointingConfig
from groundstation.pointing.search_pattern import SearchConfig, SearchPattern
from groundstation.tracking.config import Config
from groundstation.tracking.pipeline import Pipeline
from tests.stereo_rig import make_rig

WITHIN_RAD = 0.01


@pytest.fixture
def core() -> LiveCore:
    rig = make_rig()
    geometries = {s.name: s.geometry() for s in rig.stations}
    axis = AxisLimits(low_rad=-1.5, high_rad=1.5, fastest_rad_s=1.0, acceleration_rad_s2=1.0)
    controllers = {
        n: HeadController(g, HeadLimits(pan=axis, tilt=axis), PointingConfig(latency_s=0.02))
        for n, g in geometries.items()
    }
    core = LiveCore(
        Pipeline(rig, Config()),
        FramePairer(rig.names, 1.0 / 30.0),
        controllers,
        SearchPattern(geometries, SearchConfig()),
    )
    core.park(dict.fromkeys(rig.names, (0.0, 0.0)))
    return core


def add_reading(core: LiveCore, station: str, t_s: float, pan_rad: float) -> None:
    core.take(PtuSample(t_s=t_s, station=station, pan_rad=pan_rad, tilt_rad=0.0), t_s)


def test_available_heads_are_parked(core: LiveCore) -> None:
    for station in ("left", "right"):
        add_reading(core, station, 0.0, 0.002)
    assert core.not_parked(0.1, WITHIN_RAD) == []


def test_a_head_that_is_elsewhere_is_named(core: LiveCore) -> None:
    add_reading(core, "left", 0.0, 0.0)
    add_reading(core, "right", 0.0, math.radians(12.0))
    (line,) = core.not_parked(0.0, WITHIN_RAD)
    assert line == "station right: the head has not parked, it is 12.0° off"
    assert core.not_parked(0.0, WITHIN_RAD, heard=True) == [line]


def test_a_head_without_a_reply_is_named(core: LiveCore) -> None:
    """It may stand anywhere; it is not waited for."""
    add_reading(core, "left", 0.0, 0.0)
    lines = core.not_parked(8.0, WITHIN_RAD)
    assert lines[0] == "station left: the head has not answered for 8.0 s, and may not be parked"
    assert lines[1] == "station right: the head has reported no angles, and may not be parked"
    assert core.not_parked(8.0, WITHIN_RAD, heard=True) == []
