"""Planning a site: read it, compute the forecast, write the table and the picture."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.errors import InputError
from groundstation.files.output_names import below
from groundstation.files.whole_file import write_whole
from groundstation.planning.forecast import Forecast, forecast, site_map, track_down
from groundstation.planning.plan_figure import draw_plan
from groundstation.planning.plan_table import plan_csv
from groundstation.planning.site import Site
from groundstation.planning.site_file import load_site

# the map's grid: enough for smooth contours, a second to compute
_MAP_COLUMNS, _MAP_ROWS = 31, 50
_LINE_POINTS = 80
_MAP_ROOM = 1.25
_MAP_LEAST_M = 30.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlanResult:
    """The site, its forecast, and the files written (none where no folder was given)."""

    site: Site
    forecast: Forecast
    files: tuple[Path, ...]


def plan(site_path: Path, out: Path | None) -> PlanResult:
    """Plan the site of a file; writes plan.csv, plan.png and plan.svg into ``out`` where one is given."""
    site = load_site(site_path)
    if out is not None and out.exists() and not out.is_dir():
        raise InputError(str(out), got="a file", wanted="a folder")
    track = track_down(site)
    expected = forecast(site, track)
    files: tuple[Path, ...] = ()
    if out is not None:
        x_m, y_m = _grid(site)
        # lines want more points than a table has rows
        fine_m = min(site.step_m, (site.to_m - site.from_m) / _LINE_POINTS)
        fine = forecast(replace(site, step_m=fine_m), track)
        pictures = draw_plan(site, fine, x_m, y_m, site_map(site, x_m, y_m))
        contents = {".csv": plan_csv(expected).encode(), **pictures}
        out.mkdir(parents=True, exist_ok=True)
        files = tuple(below(out, f"plan{suffix}") for suffix in contents)
        for path, content in zip(files, contents.values(), strict=True):
            write_whole(path, content)
    return PlanResult(site=site, forecast=expected, files=files)


def _grid(site: Site) -> tuple[FloatArray, FloatArray]:
    """Return x and y of the map, m: as wide as the stations stand, as long as the approach."""
    places = np.array([s.ptu_position_m for s in site.rig.stations])
    half_m = max(_MAP_LEAST_M, _MAP_ROOM * float(np.abs(places[:, 0]).max()), abs(site.aircraft.x_m) + _MAP_LEAST_M)
    near_m = min(0.0, float(places[:, 1].min()))
    return np.linspace(-half_m, half_m, _MAP_COLUMNS), np.linspace(near_m, site.to_m, _MAP_ROWS)
