"""The forecast as a printed table, and which requirements it meets."""

import csv
import io

import numpy as np

from groundstation.arrays import MaskArray
from groundstation.planning.forecast import Forecast
from groundstation.planning.site import Requirement, Site

_AXES = ("x", "y", "z")
_HEAD = (
    ("range", "one pair of frames", "tracked", "tracked, with", "largest part", "aircraft", "picture", "PTU"),
    ("y, m", "noise only", "noise only", "calibration", "of that", "px", "m wide", "deg/s"),
)
_NOTHING = "–"
# as in a replay; beyond it a site is in another unit
_FAR_APART_M = 4000.0
# lenses without distortion, as planned ones are, end before
_WIDEST_DEG = 150.0


def format_plan(site: Site, f: Forecast) -> str:
    """Return the table for a terminal: what the columns mean, a row for each range, the verdicts."""
    lenses = sorted({f"{s.lens.focal_px[0]:.0f}" for s in site.rig.stations})
    lines = [
        f"{site.name}: stations {', '.join(site.rig.names)}; focal length {'/'.join(lenses)} px; "
        f"{site.frame_rate_hz:g} frames/s; {site.aircraft.speed_m_s:g} m/s",
        "1 sigma of x/y/z in m: x across, y along the runway, z up",
        "",
    ]
    rows = [*_HEAD, *(_row(site, f, k) for k in range(len(f.range_m)))]
    widths = [max(len(row[c]) for row in rows) for c in range(len(rows[0]))]
    lines += ["  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    notes = [*_doubts(site), *_notes(site, f)]
    verdicts = [verdict(site, f, wanted) for wanted in site.required]
    return "\n".join([*lines, *([""] if notes or verdicts else []), *notes, *verdicts])


def _row(site: Site, f: Forecast, k: int) -> tuple[str, ...]:
    """Return the cells of one range."""
    known, tracked = bool(f.fix_known[k]), bool(f.track_known[k])
    worst = int(np.argmax(f.track_sigma_m[k] if tracked else f.fix_sigma_m[k]))
    part = int(np.argmax(f.share[k, worst]))
    seen = f.stations[k] > 0
    return (
        f"{f.range_m[k]:.0f}",
        _triple(f.fix_noise_m[k]) if known else _NOTHING,
        _triple(f.track_noise_m[k]) if tracked else _NOTHING,
        _triple(f.track_sigma_m[k]) if tracked else _NOTHING,
        f"{_AXES[worst]}: {f.groups[part]} {100 * f.share[k, worst, part]:.0f} %" if known else _NOTHING,
        f"{f.silhouette_px[k]:.0f}{'' if f.silhouette_px[k] >= site.min_silhouette_px else ' !'}" if seen else _NOTHING,
        f"{f.field_m[k]:.0f}" if seen else _NOTHING,
        f"{np.degrees(f.turn_rad_s[k]):.2g}" if seen else _NOTHING,
    )


def _triple(sigma_m: np.ndarray) -> str:
    """Return x/y/z with as many digits as mean something."""
    return "/".join(f"{v:.3f}" if v < 0.1 else f"{v:.2f}" if v < 10 else f"{v:.0f}" for v in sigma_m)


def _doubts(site: Site) -> list[str]:
    """Return what can hardly be right of the site, as units that are not those of its file make it."""
    doubts = []
    places = np.array([station.ptu_position_m for station in site.rig.stations])
    apart_m = float(np.linalg.norm(places[:, None] - places[None], axis=2).max())
    if apart_m > _FAR_APART_M:
        doubts.append(f"! the stations are {apart_m:.0f} m apart: is the site in metres?")
    for station in site.rig.stations:
        lens = station.lens
        wide_deg = 2.0 * float(np.degrees(np.arctan(0.5 * lens.image_size_px[0] / lens.focal_px[0])))
        if wide_deg > _WIDEST_DEG:
            units = "is its focal length in mm and a pixel in µm, or focal_px in pixels?"
            doubts.append(f"! {station.name}'s picture is {wide_deg:.0f}° wide: {units}")
    return doubts


def _notes(site: Site, f: Forecast) -> list[str]:
    """Return notes on ranges without observation and on parameters assumed exact."""
    notes = []
    small = (f.stations > 0) & (f.silhouette_px < site.min_silhouette_px)
    if small.any():
        notes.append(
            f"! narrower than {site.min_silhouette_px:g} px at {ranges_text(f, small)}: not expected to be found"
        )
    large = _too_large(site, f)
    if large.any():
        notes.append(f"the aircraft fills the picture at {ranges_text(f, large)}: a shorter focal length")
    blind = ~f.fix_known
    if blind.any():
        notes.append(f"no position at {ranges_text(f, blind)}: fewer than two stations see it there")
    if not site.rig.calibration_covariance().names:
        notes.append("the mounting is taken as exact: give its sigmas in [calibration], or a rig with a covariance")
    return notes


def _too_large(site: Site, f: Forecast) -> MaskArray:
    """Return where the aircraft's span is wider than the narrowest picture."""
    width_px = min(station.lens.image_size_px[0] for station in site.rig.stations)
    return (f.stations > 0) & (f.silhouette_px > width_px)


def met_at(site: Site, f: Forecast, wanted: Requirement) -> MaskArray:
    """Return at which ranges (n,) a requirement is met."""
    limit = np.array(wanted.sigma_m)
    return np.asarray(f.track_known & np.all(f.track_sigma_m <= limit, axis=1) & ~_too_large(site, f))


def verdict(site: Site, f: Forecast, wanted: Requirement) -> str:
    """Return one line: at which ranges a requirement is met, and what to improve where it is not."""
    limit = np.array(wanted.sigma_m)
    large = _too_large(site, f)
    good = met_at(site, f, wanted)
    what = f"{wanted.name} ({'/'.join(f'{v:g}' for v in wanted.sigma_m)} m)"
    if good.all():
        return f"good enough for {what} at all ranges"
    tracked = np.flatnonzero(f.track_known & ~good & ~large)
    if not len(tracked) and large.any():
        why = f"at {ranges_text(f, large)} the aircraft fills the picture"
    elif not len(tracked):
        why = "elsewhere it is not followed" if good.any() else "it is never followed by two stations"
    else:
        k = int(tracked[np.argmin((f.track_sigma_m[tracked] / limit).max(axis=1))])
        axis = int(np.argmax(f.track_sigma_m[k] / limit))
        part = int(np.argmax(f.share[k, axis]))
        why = f"at {f.range_m[k]:.0f} m {_AXES[axis]} is {f.track_sigma_m[k, axis]:.2g} m, mostly {f.groups[part]}"
    if not good.any():
        return f"not good enough for {what}: {why}"
    return f"good enough for {what} at {ranges_text(f, good)}; {why}"


def ranges_text(f: Forecast, where: MaskArray) -> str:
    """Return the ranges of a mask as `60-240 m, 480 m`."""
    spans: list[list[float]] = []
    before = False
    for y_m, inside in zip(f.range_m, where, strict=True):
        if inside and before:
            spans[-1][1] = y_m
        elif inside:
            spans.append([y_m, y_m])
        before = bool(inside)
    return ", ".join(f"{a:.0f} m" if a == b else f"{a:.0f}-{b:.0f} m" for a, b in spans)


def plan_csv(f: Forecast) -> str:
    """Return the forecast as CSV text; a cell is empty where there is nothing."""
    kinds = (
        ("fix_noise", f.fix_noise_m, f.fix_known),
        ("fix", f.fix_sigma_m, f.fix_known),
        ("track_noise", f.track_noise_m, f.track_known),
        ("track", f.track_sigma_m, f.track_known),
    )
    shares = [(a, g) for a in range(3) for g in range(len(f.groups))]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(
        [
            "range_m",
            "stations",
            *(f"{kind}_sigma_{axis}_m" for kind, _, _ in kinds for axis in _AXES),
            "silhouette_px",
            "field_m",
            "turn_deg_s",
            *(f"share_{_AXES[a]}_{f.groups[g].replace(' ', '_')}" for a, g in shares),
        ]
    )
    for k, y_m in enumerate(f.range_m):
        seen = f.stations[k] > 0
        row = [f"{y_m:.6g}", f"{f.stations[k]:.0f}"]
        row += [f"{values[k, a]:.6g}" if known[k] else "" for _, values, known in kinds for a in range(3)]
        row += [f"{v:.6g}" if seen else "" for v in (f.silhouette_px[k], f.field_m[k], np.degrees(f.turn_rad_s[k]))]
        row += [f"{f.share[k, a, g]:.4f}" if f.fix_known[k] else "" for a, g in shares]
        writer.writerow(row)
    return text.getvalue()
