"""The operator's lines, the JSON of an estimate, and JSON lines over UDP."""

import json
import math
import socket

import numpy as np
import pytest

from groundstation.approach.approach_outputs import ApproachOutputs
from groundstation.approach.approach_state import ApproachState
from groundstation.approach.estimate_record import estimate_record
from groundstation.autopilot.local_frame import LocalFrame
from groundstation.errors import ConfigError
from groundstation.integrity.approach_advice import AdviceLevel, ApproachAdvice
from groundstation.landing.glide_path import approach_deviations
from groundstation.landing_site.landing_site_file import LandingSite
from groundstation.landing_site.planned_approach import PlannedApproach
from groundstation.landing_site.runway import LandingRunway
from groundstation.messages import Kinematics, StepReport, TrackState, TrackStatus
from groundstation.rig.rig import Rig
from groundstation.session.folder import GeoOrigin
from groundstation.sinks.udp_json import UdpJsonSender
from tests.stereo_rig import make_station

_SITE = LandingSite(
    runway=LandingRunway(threshold_m=(0.0, 100.0, 0.0)),
    approach=PlannedApproach(glide_path_rad=math.radians(4.0)),
)
_KNOWN = Kinematics(
    position_runway_m=np.array([-2.0, 300.0, 16.0]),
    velocity_runway_m_s=np.array([0.0, -20.0, -1.5]),
    covariance=np.eye(6) * 0.01,
)


def _advice(level: AdviceLevel, valid_until_s: float) -> ApproachAdvice:
    return ApproachAdvice(
        t_s=10.0,
        level=level,
        reason="protection levels within the alert limits",
        levels=None,
        limits=None,
        height_m=16.0,
        valid_until_s=valid_until_s,
        latched=False,
    )


def test_lines_name_the_side_and_the_needles_point_to_the_path() -> None:
    state = ApproachState(deviations=approach_deviations(_SITE, 10.0, _KNOWN))
    (line,) = state.lines(10.1)
    # 200 m before the aim point the path is 14 m high, and the aircraft 16 m; its own right is −x
    assert "2.0 m above" in line
    assert "2.0 m right of it" in line
    assert "200 m before it" in line
    assert "sink 1.5 m/s" in line
    path, centre = (word for word in line.split() if "+" in word or "|" in word)
    # fly down, fly left
    assert path.index("|") < 5
    assert centre.index("|") < 5


def test_a_go_that_is_no_longer_valid_is_a_wave_off() -> None:
    state = ApproachState(advice=_advice(AdviceLevel.GO, 10.5))
    assert state.lines(10.4)[0].startswith("GO: ")
    assert state.lines(10.6)[0].startswith("WAVE-OFF: no advice for 0.6 s")
    assert ApproachState(advice=_advice(AdviceLevel.WAVE_OFF, -math.inf)).lines(99.0)[0].startswith("WAVE-OFF: prot")


def test_deviations_of_long_ago_are_not_shown() -> None:
    state = ApproachState(deviations=approach_deviations(_SITE, 10.0, _KNOWN))
    assert state.lines(11.5) == ()


def test_the_record_of_an_estimate_holds_what_is_known_and_null() -> None:
    state = ApproachState(advice=_advice(AdviceLevel.GO, math.inf), deviations=approach_deviations(_SITE, 10.0, _KNOWN))
    record = estimate_record(
        10.0, TrackStatus.TRACKING, _KNOWN, frozenset({"right", "left"}), state, unix_s=1.8e9, frame=None
    )
    assert record["seen_by"] == ["left", "right"]
    assert record["unix_s"] == 1.8e9 + 10.0
    assert record["deviations"]["right_m"] == [2.0, 0.1]
    assert len(record["covariance"]) == 36
    nothing = estimate_record(1.0, TrackStatus.SEARCHING, None, frozenset(), ApproachState(), unix_s=0.0, frame=None)
    names = ("position_runway_m", "velocity_runway_m_s", "covariance", "advice", "deviations", "touchdown")
    assert [nothing[name] for name in names] == [None] * 6
    origin = GeoOrigin(lat_deg=47.3, lon_deg=8.5, height_m=460.0, y_axis_azimuth_deg=350.0)
    nothing = estimate_record(
        *(1.0, TrackStatus.SEARCHING, None, frozenset(), ApproachState()), unix_s=0.0, frame=LocalFrame(origin, 0.0)
    )
    assert [nothing[name] for name in ("lat_deg", "lon_deg", "height_ellipsoid_m")] == [None] * 3


def test_json_over_udp_has_no_number_that_json_does_not_have() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(5.0)
        sender = UdpJsonSender(f"127.0.0.1:{receiver.getsockname()[1]}")
        sender.send({"a": math.inf, "b": [math.nan, 1.5], "c": {"d": -math.inf}, "e": "text"})
        found = receiver.recv(4096)
        sender.close()
    assert found.endswith(b"\n")
    assert json.loads(found) == {"a": None, "b": [None, 1.5], "c": {"d": None}, "e": "text"}
    assert (sender.sent, sender.dropped) == (1, 0)


def test_what_the_network_does_not_take_is_counted() -> None:
    sender = UdpJsonSender("127.0.0.1:9")
    sender.send({"a": "x" * 100_000})
    sender.close()
    assert (sender.sent, sender.dropped) == (0, 1)


@pytest.mark.parametrize("address", ["", "5005", "host:", "host:70000", "a b:1", "[::1:5"])
def test_what_is_no_address_is_refused(address: str) -> None:
    with pytest.raises(ConfigError, match="--udp"):
        UdpJsonSender(address)


def test_without_reports_the_advice_ends_with_the_time() -> None:
    """Expected: never GO on silence; the change is one event for the log."""
    outputs = ApproachOutputs(
        Rig(stations=(make_station("left", -10.0), make_station("right", 10.0))), 2.3, LandingSite()
    )
    outputs.note(StepReport(states=(TrackState(t_s=1.0, status=TrackStatus.SEARCHING, kinematics=None),)), 1.0)
    events = [event for k in range(100) for event in outputs.pass_time(1.0 + 0.05 * k)]
    assert outputs.state.advice is not None
    assert outputs.state.advice.level is AdviceLevel.WAVE_OFF
    assert len(events) <= 1
    assert outputs.summary().reports == ()
