"""Why a run has no track, as far as its counts tell."""

from collections.abc import Mapping
from typing import Any


def why_no_track(counts: Mapping[str, Any]) -> str | None:
    """Return in one line why nothing was tracked, from the counts of a summary; None if something was."""
    track = counts["track"]
    total = sum(track.values())
    if track["tracking"]:
        return None
    if not total:
        return "no track: no pair of pictures was processed"
    if track["coasting"] or track["lost"]:
        return f"no track: in {total} pairs a target was found and lost again before two cameras confirmed it"
    empty = [name for name, station in counts["detection"].items() if not sum(station["status"].values())]
    if empty:
        return f"no track: {' and '.join(empty)} delivered no picture with angles in {total} pairs"
    if track["acquiring"]:
        return (
            f"no track: of {total} pairs, {track['acquiring']} had a candidate in both cameras, "
            "and none moved as an aircraft for long enough"
        )
    return f"no track: in none of {total} pairs did both cameras show a moving target at places that agree"
