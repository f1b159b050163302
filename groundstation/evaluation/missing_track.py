"""Why a run has no track, as far as its counts tell."""

from collections.abc import Mapping
from typing import Any

from groundstation.detection_messages import MissReason

# share of a station's pictures without an angle from which on that is why
_MOST_BLIND = 0.5
# what has the aircraft's rays miss each other, or makes it too near, too small or too slow
_LIKELY = "if an aircraft was there, are focal lengths, angles, clocks and places right?"


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
    stations = counts["detection"]
    if len(stations) < 2:
        names = " and ".join(stations)
        return f"no track: {f'only {names}' if names else 'no station'} delivered pictures or pixels, in {total} pairs"
    if sum(sum(station["status"].values()) for station in stations.values()) <= total:
        return (
            f"no track: each of {total} pairs has a picture or a pixel of one camera alone: "
            "frames that belong together go into one row of frames.csv"
        )
    for name, station in stations.items():
        looks, blind = sum(station["status"].values()), station["miss_reason"][MissReason.NO_PTU_ANGLE.value]
        if blind > _MOST_BLIND * looks:
            why = "its PTU's readings are missing, too far apart, or do not change"
            return f"no track: {blind} of {looks} pictures of {name} had no angle: {why}"
    if track["acquiring"]:
        return (
            f"no track: of {total} pairs, {track['acquiring']} had a candidate in two cameras, "
            f"and none moved as an aircraft for long enough; {_LIKELY}"
        )
    return f"no track: in none of {total} pairs did two cameras show a moving target at places that agree; {_LIKELY}"
