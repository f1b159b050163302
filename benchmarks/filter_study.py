"""The filter against its bounds: accuracy, consistency, calibration and clocks, outliers, borders, modes, a peer.

usage: python benchmarks/filter_study.py [--runs N] [--data FOLDER] [--workers N] [SECTION …]

Sections: bounds, gain, pipeline, reference, overlap, clocks, consider, outliers, borders, modes, peer; all by default.
FOLDER has `fixedwing-gps-log`, without which the flown landing is left out. The peer, Stone Soup, is run in a virtual
environment of its own (build/stonesoup-venv). Each case is a job; times of the peer are measured with --workers 1.
"""

import argparse
import os
from collections.abc import Callable, Iterable, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from filter_flights import adaptation, calibration, consistency, out_of_view, overlap, peer, through_pipeline
from parallel_study import StudyRun, add_study_arguments

from groundstation.arrays import FloatArray
from groundstation.estimation.config import CalibrationUse, EstimationConfig, OutOfViewWeighting

RANGES_M = (500.0, 400.0, 300.0, 200.0, 100.0)
BINS_M = ((400, 600), (250, 400), (150, 250), (60, 150))


def numbers(values: Sequence[float] | FloatArray, digits: int = 2) -> str:
    return "/".join(f"{v:.{digits}f}" for v in values)


def bounds(runs: int, _: str | None, drawn: bool, case: str, rate_hz: float) -> str:
    heads = "drawn" if drawn else "aimed"
    sample = consistency.sample_case(case, rate_hz, range(runs), drawn_heads=drawn)
    ratios = "  ".join(f"{a}-{b} m {numbers(sample.rmse_over_bound(a, b), 3)}" for a, b in BINS_M)
    low, high = consistency.chi2_range(6, runs)
    nees = numbers([sample.anees(y, 6) for y in (590.0, *RANGES_M)], 3)
    least, most = consistency.chi2_range(2, sample.nis_count())
    return (
        f"case {case}, {rate_hz:.0f} Hz, heads {heads}, {runs} flights: RMSE/bound {ratios}\n"
        f"  ANEES (6) at 590/500/400/300/200/100 m {nees}, 95 % {low:.3f} … {high:.3f}\n"
        f"  NIS {sample.nis():.4f}, 95 % {least:.4f} … {most:.4f}, {sample.refused()} pixels refused"
    )


def gain(runs: int, _: str | None, rate_hz: float, start_y_m: float) -> str:
    found = consistency.gain_over_triangulation(rate_hz, range(runs), start_y_m)
    return (
        f"gain over triangulation, case B, {rate_hz:.0f} Hz, {runs} flights from y = {start_y_m:.0f} m: "
        f"{numbers(found.filtered)} of the bounds themselves: {numbers(found.bound)}"
    )


def pipeline(runs: int, _: str | None) -> str:
    few = max(runs // 4, 2)
    sample = through_pipeline.sample_case_b(range(few))
    return (
        f"through the pipeline, case B, 10 Hz, {few} flights: RMSE/bound 60-450 m "
        f"{numbers(sample.rmse_over_bound(60, 450))} ANEES {numbers([sample.anees(y) for y in RANGES_M[1:]])}"
    )


REFERENCED = {
    "four pan and tilt biases": calibration.PAN_AND_TILT,
    "with roll and boresight": calibration.PAN_AND_TILT + calibration.ROLL_AND_BORESIGHT,
}
REFERENCE_USES = ((CalibrationUse.REFERENCE, False), (CalibrationUse.ESTIMATE, False), (CalibrationUse.REFERENCE, True))


def reference(runs: int, _: str | None, label: str, use_name: str, straight: bool) -> str:
    few, use = max(runs // 2, 2), CalibrationUse(use_name)
    sample = calibration.after_reference(REFERENCED[label], range(few), use=use, straight=straight)
    bound = np.sqrt(sample.bound_m2[:, sample.epoch_at(200.0)].mean(axis=0))
    kind = "straight glide" if straight else "drawn flights"
    return (
        f"after 8 s of DGPS, {label}, {use}, {kind}, {few} flights: RMSE over 190-210 m / bound "
        f"{numbers(sample.rmse_over_bound(190, 210))} bound at 200 m {numbers(bound, 4)} "
        f"ANEES at 300/200/100 m {numbers([sample.anees(y) for y in (300.0, 200.0, 100.0)])}"
    )


THREE_STATIONS = {"pan and tilt": overlap.PAN_AND_TILT, "whole mounts": overlap.WHOLE_MOUNTS}


def three_stations(runs: int, _: str | None, label: str, times: float, use_name: str) -> str:
    few, use = max(runs // 2, 2), CalibrationUse(use_name)
    low, high = consistency.chi2_range(3, few)
    sample = overlap.flown(THREE_STATIONS[label], range(few), use, times)
    rmse = " ".join(numbers(sample.rmse(y), 3) for y in (500, 300, 200, 100))
    return (
        f"three stations, {label} off by {times:g} x 0.05°, {use}, {few} flights: RMSE at 500/300/200/100 m {rmse} "
        f"ANEES {numbers([sample.anees(y) for y in RANGES_M])} (95 % {low:.2f} … {high:.2f})"
    )


CLOCK_FLIGHTS = {
    "drawn": calibration.clock_drawn,
    "wandering": calibration.clock_wandering,
    "take-off": calibration.clock_take_off,
}
CLOCKS = {
    "against DGPS": ("left.camera_clock.offset", *calibration.CLOCK_OFFSETS[:3]),
    "offsets": calibration.CLOCK_OFFSETS,
    "offsets and drifts": calibration.CLOCK_OFFSETS + calibration.CLOCK_DRIFTS,
}
CLOCK_CASES = (
    ("drawn", "against DGPS", "with roll and boresight"),
    ("drawn", "against DGPS", "four pan and tilt biases"),
    ("drawn", "offsets", "four pan and tilt biases"),
    ("wandering", "against DGPS", "four pan and tilt biases"),
    ("wandering", "offsets", "four pan and tilt biases"),
    ("wandering", "offsets and drifts", "four pan and tilt biases"),
    ("take-off", "against DGPS", "four pan and tilt biases"),
)


def clocks(runs: int, _: str | None, flight: str, sought: str, mounts: str) -> str:
    few, flown, biases = max(runs // 2, 2), CLOCK_FLIGHTS[flight](), REFERENCED[mounts]
    learned = calibration.learned_clocks(flown, CLOCKS[sought], range(few), biases)
    lines = [
        f"clocks and {len(biases)} biases, {flown.name}, {few} flights, 20 ms and 0.05° to learn: "
        "rms error, bound, mean (ms, ms/s)"
    ]
    means, nees = learned.error.mean(axis=0), ((learned.error / learned.sigma) ** 2).mean(axis=0)
    for name, rms, bound, mean, square in zip(
        learned.names, learned.rms(), learned.rms_bound(), means, nees, strict=True
    ):
        if "clock" in name:
            lines.append(
                f"  {name:28s} {1e3 * rms:8.2f} {1e3 * bound:8.2f} {1e3 * mean:8.2f}"
                f"  ratio {rms / bound:.2f}, NEES {square:.2f}"
            )
    return "\n".join(lines)


def consider(runs: int, _: str | None, known: bool) -> str:
    names = calibration.PAN_AND_TILT + calibration.CLOCK_OFFSETS[:3]
    sample = calibration.considered(names, range(2 * runs), known=known)
    text = "considered" if known else "ignored"
    anees = numbers([sample.anees(y) for y in RANGES_M])
    return f"biases and clocks {text}, {2 * runs} flights: ANEES at 500 … 100 m {anees}"


def outliers(runs: int, _: str | None) -> str:
    near, wide = consistency.outlier_ratio(10.0, range(runs))
    return f"5 % outliers, {runs} flights: RMSE over that without {numbers(near)}; from the wide start {numbers(wide)}"


def borders(runs: int, _: str | None, border: str, weighting_name: str) -> str:
    weighting = OutOfViewWeighting(weighting_name)
    low, high = consistency.chi2_range(3, runs)
    scene = out_of_view.fly_scene(border, weighting, range(runs))
    out = scene.nees[scene.outside > 0]
    return (
        f"border {border}, {weighting}, {runs} draws: ANEES {scene.nees.mean():.2f} "
        f"(95 % {low:.2f} … {high:.2f}), of {out.size} begun outside {out.mean():.2f}"
    )


GLIDE, MEDIUM, LARGE = (0.05, 0.1, 0.05), (0.3, 0.6, 0.3), (1.0, 4.0, 2.0)
BRISK = EstimationConfig().manoeuvre_psd_m2_s3
TUNINGS = {
    "shipped": EstimationConfig(),
    "its manoeuvre alone": adaptation.tuning(BRISK, BRISK),
    "glide alone": adaptation.tuning(GLIDE, GLIDE),
    "medium alone": adaptation.tuning(MEDIUM, MEDIUM),
    "manoeuvre alone": adaptation.tuning(LARGE, LARGE),
    "glide + manoeuvre 8/2 s": adaptation.tuning(GLIDE, LARGE),
    "glide + manoeuvre 20/2 s": adaptation.tuning(GLIDE, LARGE, 20.0, 2.0),
    "medium + manoeuvre 8/2 s": adaptation.tuning(MEDIUM, LARGE),
    "medium + manoeuvre 8/4 s": adaptation.tuning(MEDIUM, LARGE, 8.0, 4.0),
}


def modes(runs: int, data: str | None, label: str) -> str:
    few, line = max(runs // 20, 2), f"{label:26s}"
    for name, flown in adaptation.flights(None if data is None else Path(data)).items():
        rmse, anees = adaptation.errors(flown, TUNINGS[label], range(few))
        line += f" {name} {rmse[0]:.3f}/{rmse[1]:.2f}/{rmse[2]:.3f} ({anees:.2f})"
    return line


def compare_with_peer(runs: int, _: str | None) -> str:
    found = peer.side_by_side(range(max(runs // 50, 2)))
    ours, theirs = np.median(found.ours_s), np.median(found.theirs_s)
    return (
        f"RMSE in m, ours {numbers(found.ours_m, 4)}, Stone Soup {numbers(found.theirs_m, 4)}, "
        f"furthest apart {found.furthest_m:.4f} m\n"
        f"step (two readings, two pixels): {1e3 * ours:.3f} ms and {1e3 * theirs:.3f} ms, {theirs / ours:.1f} x"
    )


# a section's text for a number of runs, a folder of data and one of its cases; and its cases, each a job
SECTIONS: dict[str, tuple[Callable[..., str], Iterable[tuple[Any, ...]]]] = {
    "bounds": (bounds, tuple(product((True, False), ("B", "C"), (10.0, 30.0)))),
    "gain": (gain, tuple(product((10.0, 30.0), (600.0, 450.0)))),
    "pipeline": (pipeline, ((),)),
    "reference": (reference, tuple((label, *use) for label in REFERENCED for use in REFERENCE_USES)),
    "overlap": (
        three_stations,
        tuple(product(THREE_STATIONS, (1.0, 4.0), (CalibrationUse.CONSIDER, CalibrationUse.REFERENCE))),
    ),
    "clocks": (clocks, CLOCK_CASES),
    "consider": (consider, ((True,), (False,))),
    "outliers": (outliers, ((),)),
    "borders": (borders, tuple(product(out_of_view.BORDERS, OutOfViewWeighting))),
    "modes": (modes, tuple((label,) for label in TUNINGS)),
    "peer": (compare_with_peer, ((),)),
}


def text_of(job: tuple[str, int, str | None, tuple[Any, ...]]) -> str:
    """Return the text of one case of a section."""
    section, runs, data, case = job
    return SECTIONS[section][0](runs, data, *case)


def main() -> None:
    """Print the sections that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("sections", nargs="*", metavar="SECTION", help=", ".join(SECTIONS))
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--data", type=Path, default=os.environ.get("GROUNDSTATION_DATA"))
    add_study_arguments(parser, "filter")
    options = parser.parse_args()
    unknown = set(options.sections) - set(SECTIONS)
    if unknown:
        parser.error(f"no section {', '.join(sorted(unknown))}")
    data = None if options.data is None else str(options.data.absolute())
    jobs = {
        f"{section}-{number}": (section, options.runs, data, case)
        for section in options.sections or SECTIONS
        for number, case in enumerate(SECTIONS[section][1])
    }
    for text in StudyRun.chosen("filter", options).values(text_of, jobs).values():
        print(text)


if __name__ == "__main__":
    main()
