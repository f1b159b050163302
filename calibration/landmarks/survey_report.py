"""The result of a survey, as text and as a page with pictures."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from calibration.landmarks.fit import LandmarkFit
from calibration.landmarks.survey import Survey, inlier_landmarks, station_observations
from calibration.landmarks.survey_advice import TABLE_HEAD, SurveyAdvice, advise_survey
from calibration.landmarks.survey_pictures import survey_pictures
from calibration.report.picture import ReportPicture, shown, write_page
from calibration.robust_fit import OUTLIER_SIGMA
from groundstation.files.html_page import (
    bullet_list,
    html_page,
    page_header,
    text_table,
    verdict_line,
)

_MOST_REJECTED = 12


def format_survey(survey: Survey) -> str:
    """Return parameters, residuals, omissions, notes, verdict and next steps as text."""
    advice = advise_survey(survey)
    lines = [f"{'parameter':<32}{'value':>12}{'sigma':>12}  unit"]
    lines += [f"{name:<32}{value:>12}{sigma:>12}  {unit}" for name, value, sigma, unit in parameter_rows(survey)]
    lines += ["", *fit_lines(survey), *(f"left out: {text}" for text in rejected(survey.fit))]
    lines += [f"note: {text}" for text in survey.notes]
    if advice.table:
        lines += ["", "by what is left of the calibration's error, 1 sigma:"]
        lines += ["  " + "".join(f"{cell:>15}" for cell in row) for row in (TABLE_HEAD, *advice.table)]
    lines += ["", "verdict:", *(f"  {text}" for text in advice.verdict)]
    return "\n".join([*lines, "next:", *(f"  {text}" for text in advice.next_steps)])


def parameter_rows(survey: Survey) -> list[tuple[str, str, str, str]]:
    """Return name, value, sigma and unit of every parameter but the landmarks'; a rotation has no value."""
    rows = []
    for k, name in enumerate(survey.fit.problem.names):
        if name.startswith("landmark "):
            continue
        station, group, *axis = name.split(".")
        sigma = float(np.sqrt(survey.fit.covariance[k, k]))
        own = survey.rig[station]
        if group in ("runway_from_base", "head_from_camera"):
            change = "found" if group == "runway_from_base" else f"{np.degrees(survey.fit.change[k]):+.4f}"
            rows.append((name, change, f"{np.degrees(sigma):.4f}", "deg"))
            continue
        values = {
            "ptu_position": own.ptu_position_m,
            "camera_in_head": own.camera_in_head_m,
            "focal": own.lens.focal_px,
            "principal_point": own.lens.principal_point_px,
            "distortion": own.lens.distortion,
        }[group]
        place = ("k1", "k2", "p1", "p2", "k3").index(axis[0]) if group == "distortion" else "xyz".index(axis[0])
        unit = {"ptu_position": "m", "camera_in_head": "m", "distortion": ""}.get(group, "px")
        rows.append((name, f"{values[place]:.4f}", f"{sigma:.4f}", unit))
    return rows


def fit_lines(survey: Survey) -> list[str]:
    """Return one line for each station: the fit of its observations, and their assumed noise."""
    lines = []
    for name in survey.rig.names:
        for observed, rows in station_observations(survey.fit, name):
            kept = survey.fit.kept[rows]
            rms = float(np.sqrt(np.mean(np.sum(survey.fit.residual_px[rows][kept] ** 2, axis=1))))
            station = survey.rig[name]
            noise = (
                "fixed"
                if station.fixed
                else (
                    f"encoder {np.degrees(station.ptu_sigma_rad):.4g}° and steps of "
                    f"{np.degrees(station.ptu_resolution_rad):.4g}°"
                )
            )
            pixel = float(np.sqrt(np.median(observed.pixel_variance)))
            lines.append(
                f"{name}: {int(kept.sum())} of {len(observed)} sightings of {len(inlier_landmarks(survey.fit, name))} "
                f"landmarks, {rms:.2f} px rms; noise taken: {noise}, pixel {pixel:.2g} px"
            )
    lines.append(
        f"chi-square {survey.fit.chi_square:.1f} of {survey.fit.freedom} degrees of freedom, encoder noise in each "
        "sighting's weight"
    )
    return lines


def rejected(fit: LandmarkFit) -> list[str]:
    """Return the omissions and their reasons."""
    lines = [
        f"landmark {name}: its coordinates are {value:.0f} sigma off those by the other landmarks"
        for name, value in fit.rejected_landmarks.items()
    ]
    start = 0
    single = []
    for observed in fit.problem.observations:
        for k, sighting in enumerate(observed.sightings):
            if not fit.kept[start + k] and sighting.landmark not in fit.rejected_landmarks:
                length = fit.length[start + k]
                why = f"{length:.0f} sigma off" if np.isfinite(length) else "behind the camera"
                single.append(
                    f"line {sighting.line}, {observed.station} to {sighting.landmark}: {why}, {OUTLIER_SIGMA:g} allowed"
                )
        start += len(observed)
    more = [f"{len(single) - _MOST_REJECTED} more sightings"] if len(single) > _MOST_REJECTED else []
    return [*lines, *single[:_MOST_REJECTED], *more]


def rig_header(survey: Survey, sightings: str, landmarks: str) -> str:
    """Return the comment at the head of the rig file."""
    return (
        f"# found by a survey: {sightings!r} of {landmarks!r}\n"
        f"# covariance: joint over stations and landmarks, sigmas times {survey.fit.raised:.2f} by the fit, with floors"
        " for mounts that settle\n"
    )


def write_survey_report(folder: Path, survey: Survey, name: str) -> list[Path]:
    """Write report.html and its pictures as PNG into ``folder``, created if missing; returns the written files."""
    pictures = survey_pictures(survey)
    return write_page(folder, survey_page(survey, advise_survey(survey), pictures, name), pictures)


def survey_page(survey: Survey, advice: SurveyAdvice, pictures: Sequence[ReportPicture], name: str) -> str:
    """Return the page; it loads nothing from anywhere."""
    left_out = rejected(survey.fit)
    body = "\n".join(
        [
            page_header("survey of stations", name),
            "".join(verdict_line(f"{line[:1].upper()}{line[1:]}.") for line in advice.verdict),
            "<h2>What to do next</h2>" + bullet_list(advice.next_steps),
            "<h2>What that is in the air</h2>" + text_table(TABLE_HEAD, advice.table) if advice.table else "",
            "<h2>How it fits</h2>" + bullet_list([*fit_lines(survey), *survey.notes]),
            "<h2>What was left out</h2>" + bullet_list(left_out) if left_out else "",
            "<h2>Pictures</h2>" + shown(pictures),
            "<h2>Parameters</h2>" + text_table(("", "value", "1 σ", "unit"), parameter_rows(survey)),
        ]
    )
    return html_page(f"{name} – survey", body)
