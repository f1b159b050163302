"""The outcomes of a flight's pictures, in words: why no trajectory resulted (docs/onboard-fly.md)."""

import statistics
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

from groundstation.onboard.pose.inertial_filter import UpdateOutcome
from groundstation.onboard.visual_inertial.corner_finder import NoCorners
from groundstation.onboard.visual_inertial.nose_report import NoseReport

USED = frozenset({UpdateOutcome.STARTED.value, UpdateOutcome.USED.value, UpdateOutcome.RESTARTED.value})
WORDS: Mapping[str, str] = {
    "no_pose": "no pose to look for edges by",
    "no_edges": "no edges found",
    "edges_alone": "edges that were not tracking, not trusted yet, or were only predicted",
    "no_fit": "corners that fit no pose",
    NoCorners.OUT_OF_PICTURE: "edges, but the runway's corners outside the picture",
    NoCorners.FLAT: "edges, but a runway seen too flat",
    NoCorners.NO_NEAR: "edges, but no near threshold seen where it would be",
    NoCorners.NO_THRESHOLD: "edges, but neither threshold seen where it would be",
    NoCorners.NO_CORNER: "edges, but no corner at their ends",
    NoCorners.TURNED: "edges, but corners far from their ends",
    UpdateOutcome.GATED: "a pose that the filter refused",
    UpdateOutcome.LATE: "a pose that came too late",
}
# these have nothing to do with what runway was announced
_NOT_THE_RUNWAYS = frozenset({"no_pose", UpdateOutcome.LATE.value})


@dataclass(slots=True)
class PictureOutcomes:
    """Counts of pictures by `NoseReport.outcome`, of the details of each, and the widths that were not the runway's."""

    counts: Counter[str] = field(default_factory=Counter)
    details: dict[str, Counter[str]] = field(default_factory=dict)
    other_widths_m: list[float] = field(default_factory=list)

    def count(self, report: NoseReport) -> None:
        """Count a picture."""
        self.counts[report.outcome] += 1
        if report.detail:
            self.details.setdefault(report.outcome, Counter())[report.detail] += 1
        if report.other_width_m is not None:
            self.other_widths_m.append(report.other_width_m)


def what_failed(outcomes: PictureOutcomes, length_m: float, width_m: float) -> str:
    """Return `why_unused`, with what failed where edges were missing or not used."""
    words = why_unused(outcomes.counts, length_m, width_m)
    parts = []
    for name, details in sorted(outcomes.details.items()) if words else ():
        often = sorted(details.items(), key=lambda item: (-item[1], item[0]))
        parts.append(f" {name}: " + ", ".join(f"{count} {what}" for what, count in often) + ".")
    if words and outcomes.other_widths_m:
        apart_m = statistics.median(outcomes.other_widths_m)
        parts.append(f" Edges were {apart_m:.1f} m apart in the median where {width_m:g} m are announced.")
    return words + "".join(parts)


def why_unused(outcomes: Mapping[str, int], length_m: float, width_m: float) -> str:
    """Return why no picture's pose went into the filter, most frequent reasons first; empty where one did.

    ``outcomes`` are counts by `NoseReport.outcome`; the length and width are of the runway that was announced, m.
    """
    if any(outcomes.get(name) for name in USED):
        return ""
    pictures = sum(outcomes.values())
    if not pictures:
        return "there was no picture, so there is no trajectory"
    often = sorted(outcomes.items(), key=lambda item: (-item[1], item[0]))
    reported = f"no pose was used, so there is no trajectory; of {pictures} pictures "
    reported += "; ".join(f"{count} had {WORDS[name]} ({name})" for name, count in often)
    if not _NOT_THE_RUNWAYS.issuperset(outcomes):
        reported += f". Is the runway {width_m:g} m wide and {length_m:g} m long?"
    return reported
