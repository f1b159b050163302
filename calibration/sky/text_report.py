"""The result of a calibration by airliners and the Moon, in words."""

from calibration.sky.calibrate import SkyCalibration
from calibration.sky.pass_results import pass_place
from calibration.stars.joint_night import common_sigma
from calibration.stars.sky import utc_text
from calibration.stars.station_night import undetermined
from calibration.stars.text_report import relative_lines

_MOST_LISTED = 12
_MISFIT = 1.5
_LEAST_PASSES = 5
_LEAST_HEIGHTS_DEG = 15.0
_MOST_EMPTY_SHARE = 0.3


def format_sky(found: SkyCalibration) -> str:
    """Return the whole report."""
    night = found.night
    first, last = (utc_text(t) for t in night.span_utc_s)
    lines = [f"{first} to {last}, latitude {night.site.lat_deg:.4f}, longitude {night.site.lon_deg:.4f}", ""]
    for path, counts in zip(found.flights, found.pictures, strict=True):
        if sum(counts.values()):
            seen = ", ".join(f"{name} {count}" for name, count in counts.items())
            place = pass_place(path)
            lines.append(
                f"airliner {path.aircraft}: pictures {seen}; {place.away_km[0]:.0f} to {place.away_km[1]:.0f} km,"
                f" {place.up_deg[0]:.0f} to {place.up_deg[1]:.0f} deg high; {path.reports} positions that scatter by"
                f" {path.report_m:.0f} m"
            )
    if sum(found.moon.values()):
        lines.append("the Moon: pictures " + ", ".join(f"{name} {count}" for name, count in found.moon.items()))
    lines += [f"not used: {text}" for text in found.passed_over[:_MOST_LISTED]]
    if len(found.passed_over) > _MOST_LISTED:
        lines.append(f"not used: {len(found.passed_over) - _MOST_LISTED} more airliners")
    lines.append("")
    for one in night.joint.nights:
        fit = one.fit
        left_out = int((~fit.kept).sum())
        text = (
            f"station {one.before.name}: {int(fit.kept.sum())} pictures, {left_out} left out, {fit.rms_px:.2f} px rms"
        )
        if fit.noise_factor > _MISFIT:
            text += f"; {fit.noise_factor:.1f} times the noise of pictures and readings, the sigmas are raised by that"
        lines.append(text)
    return "\n".join([*lines, "", "verdict:", *("  " + line for line in sky_verdict(found))])


def sky_verdict(found: SkyCalibration) -> list[str]:
    """Return the verdict's lines: what is known now, and what is left open."""
    return [*what_is_told(found), *what_is_open(found)]


def what_is_told(found: SkyCalibration) -> list[str]:
    """Return the lines of what is known now: relative and common direction, the latency."""
    night = found.night
    names = [one.before.name for one in night.joint.nights]
    lines = [line for k in range(1, len(names)) for line in relative_lines(night, 0, k)]
    if len(names) == 1:
        lines.append(f"one head alone: its range hangs on another, {names[0]} says nothing of it")
    common = common_sigma(night.joint)
    source = "" if sum(found.moon.values()) else "; pictures of the Moon, or the stars, tell it better"
    lines.append(
        f"direction from true north, all heads together: {common.pan_deg:.3f} deg in pan, {common.tilt_deg:.3f} deg in"
        f" tilt (1 sigma{source})"
    )
    if found.latency_s is not None and found.latency_sigma_s is not None:
        lines.append(
            f"positions are stamped {found.latency_s:.2f} s late (sigma {found.latency_sigma_s:.2f}): the receiver's"
            " latency and what aircraft have on average"
        )
    return lines


def what_is_open(found: SkyCalibration) -> list[str]:
    """Return the lines of what the pictures say too little of, and what would tell it."""
    night, lines = found.night, []
    used = [path for path, counts in zip(found.flights, found.pictures, strict=True) if sum(counts.values())]
    if len(used) < _LEAST_PASSES and not sum(found.moon.values()):
        lines.append(f"{len(used)} airliners; wanted {_LEAST_PASSES} or more, near ones high up and far ones low down")
    heights = [height for path in used for height in pass_place(path).up_deg]
    if heights and max(heights) - min(heights) < _LEAST_HEIGHTS_DEG:
        got = f"airliners between {min(heights):.0f} and {max(heights):.0f} deg high"
        lines.append(f"{got} tell lean and boresight apart poorly; wanted {_LEAST_HEIGHTS_DEG:.0f} deg or more apart")
    for one in night.joint.nights:
        name, taken = one.before.name, found.taken[one.before.name]
        without = taken - len({int(n) for n in one.fit.problem.sightings.pointing})
        if without > _MOST_EMPTY_SHARE * taken:
            got = f"{name}: {without} of {taken} pictures show no airliner where one should be"
            lines.append(f"{got}: haze, cloud, or too far off")
    open_in: dict[str, list[str]] = {}
    for one in night.joint.nights:
        for parameter in undetermined(one):
            open_in.setdefault(parameter, []).append(one.before.name)
    if open_in:
        told = ", ".join(f"{name} ({', '.join(stations)})" for name, stations in open_in.items())
        lines.append(f"hardly better known than before: {told}; a clear night's stars tell them")
    if night.without:
        lines.append("without pictures, unchanged: " + ", ".join(night.without))
    return lines
