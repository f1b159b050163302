"""The operator's screen: what is known of an approach is on it, in Rerun's own file."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import rerun as rr

from groundstation.integrity.approach_advice import AdviceLevel, ApproachAdvice
from groundstation.landing.glide_path import ApproachDeviations, approach_deviations
from groundstation.landing_site.landing_site_file import LandingSite
from groundstation.landing_site.planned_approach import PlannedApproach
from groundstation.live.operation import ApproachSink, Operation, OperationOutputs
from groundstation.messages import Kinematics, TrackEvent
from groundstation.rig.rig import Rig
from groundstation.simulation.standard_cases import standard_rig
from groundstation.tracking.config import Config
from groundstation.tracking.registered_heads import RegisteredHeads
from groundstation.viewer import entity_paths
from groundstation.viewer.live_view import LiveView
from tests.viewer.recording import Recording

_SITE = LandingSite(approach=PlannedApproach(glide_path_rad=0.06))


def _advice(t_s: float, level: AdviceLevel) -> ApproachAdvice:
    return ApproachAdvice(
        t_s=t_s,
        level=level,
        reason="",
        levels=None,
        limits=None,
        height_m=None,
        valid_until_s=t_s + 0.5,
        latched=False,
    )


def _deviations(t_s: float) -> ApproachDeviations:
    known = Kinematics(
        position_runway_m=np.array([1.0, 200.0 - 20.0 * t_s, 12.0]),
        velocity_runway_m_s=np.array([0.0, -20.0, -1.2]),
        covariance=np.eye(6) * 0.01,
    )
    return approach_deviations(_SITE, t_s, known)


def test_an_approach_is_on_the_operators_screen(tmp_path: Path) -> None:
    """Expected: needles ten times a second, each change of the advice at once, also while nothing is estimated."""
    stream = rr.RecordingStream("test")
    stream.save(tmp_path / "screen.rrd")
    view = LiveView(stream, standard_rig(), "test")
    assert isinstance(view, ApproachSink)
    for k in range(61):
        t_s = k / 30.0
        view.show_approach(t_s, _advice(t_s, AdviceLevel.GO), _deviations(t_s), None, _SITE.runway)
    view.show_approach(2.01, _advice(2.01, AdviceLevel.WAVE_OFF), None, None, _SITE.runway)
    view.close(60.0)
    recording = Recording(tmp_path / "screen.rrd")
    assert recording.column(f"/{entity_paths.ADVICE}", "StateChange:state") == [["GO"], ["WAVE-OFF"]]
    assert recording.times_ns(f"/{entity_paths.ADVICE}") == [0, 2_010_000_000]
    for needle in (entity_paths.GLIDE_PATH_NEEDLE, entity_paths.CENTRE_LINE_NEEDLE):
        shown = recording.times_ns(f"/{needle}")
        assert 16 <= len(shown) <= 21
        assert np.all(np.diff(shown) >= 99_000_000)


def test_an_operation_shows_the_approach_after_estimates_and_after_each_line() -> None:
    shown: list[tuple[float, AdviceLevel]] = []

    class Screen:
        def write(self, report: Any) -> None:
            """Lines of the log."""

        def close(self) -> None:
            """Nothing is open."""

        def show_approach(self, t_s: float, advice: Any, deviations: Any, touchdown: Any, runway: Any) -> None:
            shown.append((t_s, advice.level))

    known = SimpleNamespace(advice=_advice(0.0, AdviceLevel.CAUTION), deviations=None, touchdown=None)
    approach: Any = SimpleNamespace(runway=_SITE.runway, state=known)
    operation = _operation(Screen(), standard_rig())
    line = TrackEvent(t_s=1.0, level="warning", text="CAUTION: one station")
    for events, seen in (([], False), ([line], False), ([], True)):
        operation._follow_approach(approach, events, seen=seen)
    assert shown == [(0.0, AdviceLevel.CAUTION)] * 2


def _operation(screen: Any, rig: Rig) -> Operation:
    file: Any = SimpleNamespace(rate_hz=30.0)
    outputs, heads = OperationOutputs(sinks=[screen]), RegisteredHeads(rig, {})
    return Operation(file, rig, Config(), outputs, clock=lambda: 0.0, heads=heads)
