"""The outputs of an approach during a replay: fed with its reports, in session time or at the recording's own speed."""

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from typing import TYPE_CHECKING

from groundstation.approach.approach_options import ApproachOptions, SessionTime, open_approach
from groundstation.approach.approach_outputs import ApproachOutputs, ApproachSummary
from groundstation.messages import Event, StepReport, TrackEvent
from groundstation.replay.replay_request import ReplayRequest
from groundstation.session import Session
from groundstation.sinks.sink import Sink
from groundstation.tracking.pipeline import Pipeline
from groundstation.viewer.approach_row import ApproachRow

if TYPE_CHECKING:
    from groundstation.viewer.rerun_sink import RerunSink

# a stream of 50 Hz wants to be looked after more often than that
_LOOK_EVERY_S = 0.004


class ApproachReplay:
    """Outputs of an approach in a replay; a sink of its reports, and in real time also what paces its events.

    Parameters
    ----------
    options, realtime : as requested.
    session, pipeline : of the replay.
    from_s : session time of its first event.
    sinks : get the events that the outputs have for the log.
    view : gets what is known of the approach after each report; None without one.
    clock, sleep : the host's monotonic clock, s, and its waiting.
    """

    def __init__(
        self,
        options: ApproachOptions,
        session: Session,
        pipeline: Pipeline,
        from_s: float,
        sinks: Sequence[Sink],
        *,
        realtime: bool,
        view: "RerunSink | None" = None,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._clock, self._sleep, self._realtime, self._sinks = clock, sleep, realtime, sinks
        self._link_s = clock() - from_s
        self._newest_s, self._view = from_s, view
        self.outputs: ApproachOutputs = open_approach(
            options,
            session.rig,
            session.target.span_m,
            session.origin,
            session.dgps.reading.geoid_separation_m,
            SessionTime(now_s=self._now_s, link_s=self._link_s, unix_s=time.time() - from_s),
            pipeline.estimate_at,
        )

    def paced(self, events: Iterable[Event]) -> Iterator[Event]:
        """Yield the events; in real time each when the time since the first is that of the recording."""
        for event in events:
            self._newest_s = max(self._newest_s, event.t_s)
            if self._realtime:
                while self._now_s() < event.t_s:
                    self._pass_time()
                    self._sleep(max(min(event.t_s - self._now_s(), _LOOK_EVERY_S), 0.0))
            yield event
            self._pass_time()

    def write(self, report: StepReport) -> None:
        """Take a report of the pipeline."""
        now_s = self._now_s()
        self._emit(self.outputs.note(report, now_s))
        if self._view is not None and report.estimates:
            state = self.outputs.state
            row = ApproachRow(
                t_s=report.estimates[-1].t_s,
                advice=state.advice,
                deviations=state.deviations,
                touchdown=state.touchdown,
            )
            self._view.write_approach(row, self.outputs.runway)

    def close(self) -> None:
        """Nothing is open."""

    def finish(self) -> ApproachSummary:
        """End the outputs, and return what came of them."""
        self._emit(self.outputs.finish())
        return self.outputs.summary()

    def _now_s(self) -> float:
        return self._clock() - self._link_s if self._realtime else self._newest_s

    def _pass_time(self) -> None:
        self._emit(self.outputs.pass_time(self._now_s()))

    def _emit(self, events: Sequence[TrackEvent]) -> None:
        if events:
            report = StepReport(events=tuple(events))
            for sink in self._sinks:
                sink.write(report)


def approach_replay(
    request: ReplayRequest,
    session: Session,
    pipeline: Pipeline,
    from_s: float,
    sinks: Sequence[Sink],
    opened: ExitStack,
    *,
    view: "RerunSink | None" = None,
) -> ApproachReplay | None:
    """Return the outputs that a replay asks for, closed with ``opened``; None if it asks for none."""
    if not request.approach.wanted and not request.realtime:
        return None
    found = ApproachReplay(request.approach, session, pipeline, from_s, sinks, realtime=request.realtime, view=view)
    opened.callback(found.outputs.close)
    return found
