"""What is known of an approach at one time, and its lines for the operator."""

from dataclasses import dataclass

from groundstation.integrity.approach_advice import AdviceLevel, ApproachAdvice
from groundstation.integrity.gnss_watch import GnssAssessment, GnssVerdict
from groundstation.landing.glide_path import ApproachDeviations
from groundstation.landing.touchdown import NoTouchdown, TouchdownForecast

# a needle as text: so many places to each side
_NEEDLE_PLACES = 5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ApproachState:
    """Advice, deviations, touchdown foretold and verdict on the aircraft's own GNSS; None where there is none."""

    advice: ApproachAdvice | None = None
    deviations: ApproachDeviations | None = None
    touchdown: TouchdownForecast | None = None
    no_touchdown: NoTouchdown | None = None
    gnss: GnssAssessment | None = None

    def lines(self, now_s: float) -> tuple[str, ...]:
        """Return the operator's lines at session time ``now_s``; an advice that is no longer valid is a wave-off."""
        lines = [] if self.advice is None else [_advice_line(self.advice, now_s)]
        if self.deviations is not None and now_s - self.deviations.t_s <= 1.0:
            lines.append(_deviations_line(self.deviations))
            if self.touchdown is not None:
                lines.append(_touchdown_line(self.touchdown, now_s))
        if self.gnss is not None and self.gnss.verdict is not GnssVerdict.NO_TRACK:
            lines.append(f"aircraft's GNSS: {self.gnss.reason or self.gnss.verdict}")
        return tuple(lines)


def _advice_line(advice: ApproachAdvice, now_s: float) -> str:
    if now_s > advice.valid_until_s and advice.level is not AdviceLevel.WAVE_OFF:
        return f"{AdviceLevel.WAVE_OFF}: no advice for {now_s - advice.t_s:.1f} s"
    line = f"{advice.level}: {advice.reason}" if advice.reason else str(advice.level)
    levels, limits = advice.levels, advice.limits
    if levels is None or limits is None:
        return line
    pairs = (
        ("lateral", levels.lateral_m, limits.lateral_m),
        ("vertical", levels.vertical_m, limits.vertical_m),
        ("along", levels.along_m, limits.along_m),
    )
    return f"{line} (protected to " + ", ".join(f"{name} {pl:.1f} of {al:g} m" for name, pl, al in pairs) + ")"


def _deviations_line(found: ApproachDeviations) -> str:
    words = []
    path = found.glide_path
    if path is not None:
        side = "above" if path.above.value >= 0.0 else "below"
        words.append(f"path {_needle(path.needle)} {abs(path.above.value):.1f} m {side}")
    side = "right" if found.right.value >= 0.0 else "left"
    words.append(f"centre line {_needle(found.centre_line_needle)} {abs(found.right.value):.1f} m {side} of it")
    before_m = found.to_threshold.value
    place = f"{before_m:.0f} m before it" if before_m >= 0.0 else f"{-before_m:.0f} m past it"
    words.append(f"{found.height.value:.1f} m over the threshold, {place}")
    words.append(f"sink {found.sink_rate.value:.1f} m/s")
    return ", ".join(words)


def _touchdown_line(found: TouchdownForecast, now_s: float) -> str:
    along, right = found.half_axes_m
    side = "right" if found.point_m[1] >= 0.0 else "left"
    return (
        f"touchdown in {max(found.t_s - now_s, 0.0):.1f} s, {found.point_m[0]:.0f} ± {along:.0f} m past the threshold, "
        f"{abs(found.point_m[1]):.1f} ± {right:.1f} m {side}, on the runway {100 * found.on_runway:.0f} %"
    )


def _needle(value: float) -> str:
    """Return a needle, −1 to 1, as text: the aircraft in the middle, the path where the mark is."""
    places = ["·"] * (2 * _NEEDLE_PLACES + 1)
    places[_NEEDLE_PLACES] = "+"
    places[_NEEDLE_PLACES + round(max(-1.0, min(1.0, value)) * _NEEDLE_PLACES)] = "|"
    return "".join(places)
