"""What one approach has shown so far, from its first estimate on, until it ends."""

from groundstation.landing.glide_path import ApproachDeviations
from groundstation.landing.landing_report import (
    ApproachOutcome,
    LandingReport,
    WorstSigma,
    check_forecasts,
    statistics_of,
)
from groundstation.landing.touchdown import TouchdownForecast
from groundstation.landing.touchdown_detection import Touchdown
from groundstation.messages import TrackEvent

# an aircraft has gone around that climbs so fast, m/s, for so long, so far above its lowest point
_CLIMB_M_S, _CLIMBED_S, _CLIMBED_M = 1.0, 1.0, 3.0
# forecasts kept for the comparison with the touchdown, and lines of the log, at most
_FORECASTS, _EVENTS = 200, 500


class ApproachRecord:
    """One approach; ``low_height_m`` is where the deviations from the glide path end: below is the flare."""

    def __init__(self, number: int, first_s: float, low_height_m: float) -> None:
        self._number, self._first_s, self._low_m = number, first_s, low_height_m
        self.last_s = first_s
        # whether the wheels have been near the surface, and then higher again
        self.touched = False
        self._right: list[float] = []
        self._above: list[float] = []
        self._worst: dict[str, WorstSigma] = {}
        self._forecasts: list[TouchdownForecast] = []
        self._events: list[TrackEvent] = []
        self._threshold_height_m: float | None = None
        self._before: ApproachDeviations | None = None
        self._lowest_m = float("inf")
        self._climbs_since_s: float | None = None

    def add(self, found: ApproachDeviations) -> None:
        """Take the deviations of an estimate."""
        self.last_s = found.t_s
        self._right.append(found.right.value)
        if found.glide_path is not None and found.height.value > self._low_m:
            self._above.append(found.glide_path.above.value)
        named = (("along", found.to_threshold), ("lateral", found.right), ("vertical", found.height))
        for name, value in named:
            known = self._worst.get(name)
            if known is None or value.sigma > known.sigma_m:
                self._worst[name] = WorstSigma(
                    sigma_m=value.sigma, t_s=found.t_s, to_threshold_m=found.to_threshold.value
                )
        self._pass_threshold(found)
        self._watch_climb(found)
        self._before = found

    def add_forecast(self, forecast: TouchdownForecast) -> None:
        """Take a forecast; the newest are kept."""
        self._forecasts = [*self._forecasts[1 - _FORECASTS :], forecast]

    def add_event(self, event: TrackEvent) -> None:
        """Take a line of the log; so many as an approach has."""
        if len(self._events) < _EVENTS:
            self._events.append(event)

    @property
    def has_gone_around(self) -> bool:
        """Whether the aircraft climbs away."""
        return self._climbs_since_s is not None and self.last_s - self._climbs_since_s >= _CLIMBED_S

    def report(self, outcome: ApproachOutcome, touchdown: Touchdown | None) -> LandingReport:
        """Return the report of the approach as it has ended."""
        centre_line = statistics_of(self._right)
        if centre_line is None:
            raise ValueError(f"approach {self._number}: got no estimate, wanted one or more")
        return LandingReport(
            number=self._number,
            outcome=outcome,
            from_s=self._first_s,
            to_s=self.last_s,
            touchdown=touchdown,
            threshold_height_m=self._threshold_height_m,
            centre_line=centre_line,
            glide_path=statistics_of(self._above),
            worst=dict(self._worst),
            forecasts=() if touchdown is None else check_forecasts(self._forecasts, touchdown),
            events=tuple(self._events),
        )

    def _pass_threshold(self, found: ApproachDeviations) -> None:
        before = self._before
        if before is not None and before.to_threshold.value > 0.0 >= found.to_threshold.value:
            share = before.to_threshold.value / (before.to_threshold.value - found.to_threshold.value)
            rise = found.height.value - before.height.value
            self._threshold_height_m = before.height.value + share * rise

    def _watch_climb(self, found: ApproachDeviations) -> None:
        self._lowest_m = min(self._lowest_m, found.height.value)
        climbs = -found.sink_rate.value >= _CLIMB_M_S and found.height.value > self._lowest_m + _CLIMBED_M
        if not climbs:
            self._climbs_since_s = None
        elif self._climbs_since_s is None:
            self._climbs_since_s = found.t_s
