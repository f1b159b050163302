"""Wrong positions while two cameras detect the target: they replace nothing, are counted, and are reported."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from groundstation.estimation.parameters import DGPS_CLOCK, ParameterPrior
from groundstation.messages import Event, PixelMeasurement, ReferenceFix, TrackEstimate, TrackEvent, TrackStatus
from groundstation.rig.rig import Rig
from groundstation.tracking.pipeline import Pipeline
from tests.replay.test_late_data import START, tuning
from tests.stereo_rig import flight_events, glide, make_rig

# from here on the target is fixed by two cameras
FROM_S, TO_S = 1.0, 6.0
OFF_M = np.array([0.0, 0.0, 50.0])


def open_rig() -> Rig:
    """A rig with uncertain mounts: a reference may correct it, and so may replace the target."""
    names = ("runway_from_base.x", "runway_from_base.z")
    known = {"covariance_parameters": names, "covariance": np.eye(2) * np.radians(0.05) ** 2}
    rig = make_rig()
    return replace(rig, stations=tuple(replace(s, **known) for s in rig.stations))


def sent(off_m: np.ndarray, from_s: float = FROM_S, rate_hz: float = 50.0) -> list[Event]:
    """Positions ``off_m`` next to the aircraft, each claimed to be good to 2 cm."""
    return [
        ReferenceFix(t_s=float(t), position_runway_m=glide(float(t)) + off_m, sigma_m=np.full(3, 0.02))
        for t in np.arange(from_s + 0.003, TO_S - 0.1, 1.0 / rate_hz)
    ]


@dataclass
class Flown:
    pipeline: Pipeline
    estimates: list[TrackEstimate]
    events: list[TrackEvent]

    def positions(self) -> np.ndarray:
        return np.array([e.kinematics.position_runway_m for e in self.estimates if e.kinematics is not None])


def flown(references: Iterable[Event], *, one_camera_from_s: float = np.inf, clock_sigma_s: float = 0.02) -> Flown:
    events = list(flight_events(open_rig(), glide, np.random.default_rng(8), duration_s=TO_S))
    events = [
        e for e in events if not (isinstance(e, PixelMeasurement) and e.station == "left" and e.t_s > one_camera_from_s)
    ]
    clock = ParameterPrior.independent([f"{DGPS_CLOCK}.offset"], [clock_sigma_s])
    pipeline = Pipeline(open_rig(), tuning(), span_m=2.3, initial=START, reference_errors=clock)
    reports = [pipeline.step(e) for e in sorted([*events, *references], key=lambda e: e.t_s)]
    reports.append(pipeline.finish())
    return Flown(pipeline, [e for r in reports for e in r.estimates], [e for r in reports for e in r.events])


def contradictions(result: Flown) -> list[str]:
    return [e.text for e in result.events if "contradicts the cameras" in e.text]


def test_hundreds_of_wrong_positions_move_nothing() -> None:
    """Expected: the track of the same flight without them; before, the first one put the target 50 m off."""
    alone, disturbed = flown([]), flown(strange := sent(OFF_M))
    assert len(strange) > 200
    assert disturbed.pipeline.counts["references_refused"] == len(strange)
    assert disturbed.pipeline.reference_used_until_s is None
    assert [e.status for e in disturbed.estimates] == [e.status for e in alone.estimates]
    assert disturbed.estimates[-1].status is TrackStatus.TRACKING
    # the filter stands at their times, too, and its modes are mixed a little more often
    sigma = np.sqrt(np.diag(alone.pipeline._ekf.covariance)[:3])
    assert np.all(np.abs(disturbed.positions() - alone.positions()) < 0.01 * sigma)
    lines = contradictions(disturbed)
    # one at once, then one in five seconds
    assert 1 <= len(lines) <= 3
    assert lines[0].startswith("reference receiver contradicts the cameras by 5")


def test_an_accepted_receiver_that_fails_replaces_nothing() -> None:
    """The first position is right, then each is 50 m off. Before, the sixth of them in a row replaced the target's."""
    right = [e for e in sent(np.zeros(3), rate_hz=5.0) if e.t_s < 1.1]
    wrong = sent(OFF_M, from_s=1.2)
    good, bad = flown(right), flown([*right, *wrong])
    assert bad.pipeline.counts["references_refused"] == len(wrong)
    assert good.pipeline.reference_used_until_s == bad.pipeline.reference_used_until_s
    sigma = np.sqrt(np.diag(good.pipeline._ekf.covariance)[:3])
    assert np.all(np.abs(bad.positions()[-1] - good.positions()[-1]) < 0.01 * sigma)
    assert contradictions(bad)


def test_what_the_rigs_errors_explain_still_replaces_the_first_time() -> None:
    """Four metres out along the axis of uncertainty of a rig with 0.05°: a reference may correct it."""
    result = flown(sent(np.array([0.0, 4.0, 0.0]), rate_hz=5.0))
    assert result.pipeline.reference_used_until_s is not None
    end_m = glide(result.estimates[-1].t_s)
    assert result.positions()[-1][1] - end_m[1] == pytest.approx(4.0, abs=0.5)
    assert not contradictions(result)


def test_one_camera_alone_may_be_corrected() -> None:
    """Without a fix for more than a second the receiver's word counts, as far off as it is."""
    lost_s = 2.0
    result = flown(sent(OFF_M, from_s=4.0), one_camera_from_s=lost_s)
    assert result.pipeline.reference_used_until_s is not None


def test_a_position_contradicted_by_two_cameras_does_not_replace_the_target_when_one_is_lost() -> None:
    """Expected: not accepted before it agrees; five in a row moved the target 1.1 s after the loss."""
    alone, disturbed = flown([], one_camera_from_s=3.0), flown(sent(OFF_M), one_camera_from_s=3.0)
    assert disturbed.pipeline.reference_used_until_s is None
    assert disturbed.estimates[-1].status is TrackStatus.COASTING
    sigma = np.sqrt(np.diag(alone.pipeline._ekf.covariance)[:3])
    assert np.all(np.abs(disturbed.positions()[-1] - alone.positions()[-1]) < 0.1 * sigma)


def test_a_receiver_that_agrees_again_is_accepted_again() -> None:
    """Contradicted while two cameras detected the target, then right: each right one is used."""
    wrong = [e for e in sent(OFF_M, rate_hz=5.0) if e.t_s < 2.0]
    right = [e for e in sent(np.zeros(3), from_s=2.5, rate_hz=5.0) if e.t_s < 2.8]
    result = flown([*wrong, *right])
    assert result.pipeline.counts["references_refused"] == len(wrong)
    assert result.pipeline.reference_used_until_s == right[-1].t_s
    assert not result.pipeline._ekf.snapshot().bookkeeping.references.contradicted


def test_the_same_flight_gives_the_same_result_again() -> None:
    first, second = flown(sent(OFF_M)), flown(sent(OFF_M))
    np.testing.assert_array_equal(first.positions(), second.positions())
    assert [e.text for e in first.events] == [e.text for e in second.events]


@pytest.mark.parametrize(("rate_hz", "sigma_m", "drift_m_s"), [(20.0, 0.02, 3.0), (50.0, 0.02, 8.0), (20.0, 1.0, 3.0)])
def test_a_receiver_that_drifts_away_does_not_take_the_target_along(
    rate_hz: float, sigma_m: float, drift_m_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each position passes near the one before. Before, the target was 11 to 15 m off at the end, none was refused."""
    monkeypatch.setattr("tests.replay.test_reference_stranger.open_rig", make_rig)
    drifting = [
        replace(
            e,
            position_runway_m=e.position_runway_m + np.array([0.0, drift_m_s * (e.t_s - FROM_S), 0.0]),
            sigma_m=np.full(3, sigma_m),
        )
        for e in sent(np.zeros(3), rate_hz=rate_hz)
        if isinstance(e, ReferenceFix)
    ]
    result, alone = flown(drifting), flown([])
    last, own = result.estimates[-1], alone.estimates[-1]
    assert last.status is TrackStatus.TRACKING
    assert last.kinematics is not None
    assert own.kinematics is not None
    sigma = np.sqrt(np.diag(own.kinematics.covariance)[:3])
    assert np.all(np.abs(last.kinematics.position_runway_m - own.kinematics.position_runway_m) < 3.0 * sigma)
    # refused where the receiver's clock does not explain it: its lag along the path is estimated, within its sigma
    assert result.pipeline.counts["references_refused"] > 0
    assert contradictions(result)
