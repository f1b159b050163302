"""A day's pictures of the sky: the folder read, what stands out in each, and the receiver's lines next to them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from calibration.head_picture import HeadPicture, listed_fields
from calibration.picture_table import read_picture_table
from calibration.sky.adsb import AdsbReport, read_adsb
from calibration.sky.sky_objects import SeenMoon, SkyObjects, find_moon, find_objects
from calibration.stars.night import read_grey, require_one_night
from calibration.stars.sky import SkyOverSite
from groundstation.errors import InputError
from groundstation.rig.rig import Rig

ADSB_FILES = ("adsb.jsonl", "adsb.json", "adsb.sbs", "adsb.txt")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SkyPicture(HeadPicture):
    """One picture of the sky by day; ``seen`` is what stands out in it, ``moon`` its disc's centre where it shows."""

    seen: SkyObjects
    moon: SeenMoon | None = None


def read_day(
    folder: Path, rig: Rig, sky: SkyOverSite, progress: Callable[[int, int], None] = lambda done, of: None
) -> tuple[SkyPicture, ...]:
    """Return the pictures of ``folder``/pictures.csv in order of time; raises `InputError` for a faulty one."""
    listed = read_picture_table(folder, rig, timed=True)
    require_one_night(folder, listed)
    found = []
    for number, item in enumerate(listed):
        progress(number + 1, len(listed))
        grey = read_grey(folder, item, rig)
        radius = sky.moon_radius_rad(item.utc_s) * float(rig[item.station].lens.focal_px.mean())
        up = sky.body("moon", item.utc_s)[2] > 0.0
        moon = find_moon(grey, radius) if up else None
        found.append(SkyPicture(**listed_fields(item), seen=find_objects(grey), moon=moon))
    return tuple(sorted(found, key=lambda p: p.utc_s))


def find_adsb(folder: Path, given: Path | None) -> dict[str, tuple[AdsbReport, ...]]:
    """Return the reports of a given file, or of the one next to the pictures; none where there is no file."""
    if given is not None:
        return read_adsb(given)
    there = [folder / name for name in ADSB_FILES if (folder / name).is_file()]
    if len(there) > 1:
        got = " and ".join(path.name for path in there)
        raise InputError(str(folder), got=got, wanted="one of them, or --adsb FILE")
    return read_adsb(there[0]) if there else {}


def require_same_time(pictures: Sequence[SkyPicture], reports: dict[str, tuple[AdsbReport, ...]]) -> None:
    """Raise `InputError` where the receiver's times are not those of the pictures."""
    first, last = pictures[0].utc_s, pictures[-1].utc_s
    begin = min(own[0].t_s for own in reports.values())
    end = max(own[-1].t_s for own in reports.values())
    if end < first or begin > last:
        away = first - end if end < first else last - begin
        got = f"positions that {'end' if end < first else 'begin'} {abs(away):.0f} s from the pictures' times"
        raise InputError("ADS-B", got=got, wanted="both in UTC (SBS lines carry the receiver's own time zone)")
