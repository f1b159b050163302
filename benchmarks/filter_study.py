"""The filter against its bounds: accuracy, consistency, calibration and clocks, outliers, borders, modes, a peer.

usage: python benchmarks/filter_study.py [--runs N] [--data FOLDER] [SECTION …]

Sections: bounds, gain, pipeline, reference, overlap, clocks, consider, outliers, borders, modes, peer; all by default.
FOLDER has `fixedwing-gps-log`, without which the flown landing is left out. The peer, Stone Soup, is run in a virtual
environment of its own (build/stonesoup-venv).
"""

import argparse
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from filter_flights import adaptation, calibration, consistency, out_of_view, overlap, peer, through_pipeline

from groundstation.arrays import FloatArray
from groundstation.estimation.config import CalibrationUse, EstimationConfig, OutOfViewWeighting

RANGES_M = (500.0, 400.0, 300.0, 200.0, 100.0)
BINS_M = ((400, 600), (250, 400), (150, 250), (60, 150))


def numbers(values: Sequence[float] | FloatArray, digits: int = 2) -> str:
    return "/".join(f"{v:.{digits}f}" for v in values)


def bounds(runs: int, _: Path | None) -> None:
    for drawn in (True, False):
        heads = "drawn" if drawn else "aimed"
        for case in ("B", "C"):
            for rate_hz in (10.0, 30.0):
                sample = consistency.sample_case(case, rate_hz, range(runs), drawn_heads=drawn)
                ratios = "  ".join(f"{a}-{b} m {numbers(sample.rmse_over_bound(a, b), 3)}" for a, b in BINS_M)
                print(f"case {case}, {rate_hz:.0f} Hz, heads {heads}, {runs} flights: RMSE/bound {ratios}")
                low, high = consistency.chi2_range(6, runs)
                nees = numbers([sample.anees(y, 6) for y in (590.0, *RANGES_M)], 3)
                print(f"  ANEES (6) at 590/500/400/300/200/100 m {nees}, 95 % {low:.3f} … {high:.3f}")
                low, high = consistency.chi2_range(2, sample.nis_count())
                print(f"  NIS {sample.nis():.4f}, 95 % {low:.4f} … {high:.4f}, {sample.refused()} pixels refused")


def gain(runs: int, _: Path | None) -> None:
    for rate_hz in (10.0, 30.0):
        for start_y_m in (600.0, 450.0):
            found = consistency.gain_over_triangulation(rate_hz, range(runs), start_y_m)
            begun = f"{runs} flights from y = {start_y_m:.0f} m"
            print(f"gain over triangulation, case B, {rate_hz:.0f} Hz, {begun}: {numbers(found.filtered)}", end=" ")
            print(f"of the bounds themselves: {numbers(found.bound)}")


def pipeline(runs: int, _: Path | None) -> None:
    few = max(runs // 4, 2)
    sample = through_pipeline.sample_case_b(range(few))
    print(f"through the pipeline, case B, 10 Hz, {few} flights: RMSE/bound 60-450 m", end=" ")
    print(numbers(sample.rmse_over_bound(60, 450)), "ANEES", numbers([sample.anees(y) for y in RANGES_M[1:]]))


def reference(runs: int, _: Path | None) -> None:
    few = max(runs // 2, 2)
    for label, names in (
        ("four pan and tilt biases", calibration.PAN_AND_TILT),
        ("with roll and boresight", calibration.PAN_AND_TILT + calibration.ROLL_AND_BORESIGHT),
    ):
        for use, straight in (
            (CalibrationUse.REFERENCE, False),
            (CalibrationUse.ESTIMATE, False),
            (CalibrationUse.REFERENCE, True),
        ):
            sample = calibration.after_reference(names, range(few), use=use, straight=straight)
            k = sample.epoch_at(200.0)
            bound = np.sqrt(sample.bound_m2[:, k].mean(axis=0))
            kind = "straight glide" if straight else "drawn flights"
            print(f"after 8 s of DGPS, {label}, {use}, {kind}, {few} flights: RMSE over 190-210 m / bound", end=" ")
            print(numbers(sample.rmse_over_bound(190, 210)), "bound at 200 m", numbers(bound, 4), end=" ")
            print("ANEES at 300/200/100 m", numbers([sample.anees(y) for y in (300.0, 200.0, 100.0)]))


def three_stations(runs: int, _: Path | None) -> None:
    few = max(runs // 2, 2)
    low, high = consistency.chi2_range(3, few)
    for label, names in (("pan and tilt", overlap.PAN_AND_TILT), ("whole mounts", overlap.WHOLE_MOUNTS)):
        for times in (1.0, 4.0):
            for use in (CalibrationUse.CONSIDER, CalibrationUse.REFERENCE):
                sample = overlap.flown(names, range(few), use, times)
                print(f"three stations, {label} off by {times:g} x 0.05°, {use}, {few} flights:", end=" ")
                print("RMSE at 500/300/200/100 m", *(numbers(sample.rmse(y), 3) for y in (500, 300, 200, 100)), end=" ")
                print("ANEES", numbers([sample.anees(y) for y in RANGES_M]), f"(95 % {low:.2f} … {high:.2f})")


def clocks(runs: int, _: Path | None) -> None:
    few = max(runs // 2, 2)
    against_dgps = ("left.camera_clock.offset", *calibration.CLOCK_OFFSETS[:3])
    mounts, everything = calibration.PAN_AND_TILT, calibration.PAN_AND_TILT + calibration.ROLL_AND_BORESIGHT
    for flown, names, biases in (
        (calibration.clock_drawn(), against_dgps, everything),
        (calibration.clock_drawn(), against_dgps, mounts),
        (calibration.clock_drawn(), calibration.CLOCK_OFFSETS, mounts),
        (calibration.clock_wandering(), against_dgps, mounts),
        (calibration.clock_wandering(), calibration.CLOCK_OFFSETS, mounts),
        (calibration.clock_wandering(), calibration.CLOCK_OFFSETS + calibration.CLOCK_DRIFTS, mounts),
        (calibration.clock_take_off(), against_dgps, mounts),
    ):
        learned = calibration.learned_clocks(flown, names, range(few), biases)
        print(f"clocks and {len(biases)} biases, {flown.name}, {few} flights, 20 ms and 0.05° to learn:", end=" ")
        print("rms error, bound, mean (ms, ms/s)")
        nees = (learned.error / learned.sigma) ** 2
        rows = zip(
            learned.names,
            learned.rms(),
            learned.rms_bound(),
            learned.error.mean(axis=0),
            nees.mean(axis=0),
            strict=True,
        )
        for name, rms, bound, mean, square in rows:
            if "clock" in name:
                print(f"  {name:28s} {1e3 * rms:8.2f} {1e3 * bound:8.2f} {1e3 * mean:8.2f}", end="")
                print(f"  ratio {rms / bound:.2f}, NEES {square:.2f}")


def consider(runs: int, _: Path | None) -> None:
    names = calibration.PAN_AND_TILT + calibration.CLOCK_OFFSETS[:3]
    for known in (True, False):
        sample = calibration.considered(names, range(2 * runs), known=known)
        text = "considered" if known else "ignored"
        print(f"biases and clocks {text}, {2 * runs} flights: ANEES at 500 … 100 m", end=" ")
        print(numbers([sample.anees(y) for y in RANGES_M]))


def outliers(runs: int, _: Path | None) -> None:
    near, wide = consistency.outlier_ratio(10.0, range(runs))
    print(f"5 % outliers, {runs} flights: RMSE over that without {numbers(near)}; from the wide start {numbers(wide)}")


def borders(runs: int, _: Path | None) -> None:
    low, high = consistency.chi2_range(3, runs)
    for border in out_of_view.BORDERS:
        for weighting in OutOfViewWeighting:
            scene = out_of_view.fly_scene(border, weighting, range(runs))
            out = scene.nees[scene.outside > 0]
            print(f"border {border}, {weighting}, {runs} draws: ANEES {scene.nees.mean():.2f}", end=" ")
            print(f"(95 % {low:.2f} … {high:.2f}), of {out.size} begun outside {out.mean():.2f}")


def modes(runs: int, data: Path | None) -> None:
    few = max(runs // 20, 2)
    glide, medium, large = (0.05, 0.1, 0.05), (0.3, 0.6, 0.3), (1.0, 4.0, 2.0)
    shipped = EstimationConfig()
    brisk = shipped.manoeuvre_psd_m2_s3
    tunings = {
        "shipped": shipped,
        "its manoeuvre alone": adaptation.tuning(brisk, brisk),
        "glide alone": adaptation.tuning(glide, glide),
        "medium alone": adaptation.tuning(medium, medium),
        "manoeuvre alone": adaptation.tuning(large, large),
        "glide + manoeuvre 8/2 s": adaptation.tuning(glide, large),
        "glide + manoeuvre 20/2 s": adaptation.tuning(glide, large, 20.0, 2.0),
        "medium + manoeuvre 8/2 s": adaptation.tuning(medium, large),
        "medium + manoeuvre 8/4 s": adaptation.tuning(medium, large, 8.0, 4.0),
    }
    for label, config in tunings.items():
        print(f"{label:26s}", end="")
        for name, flown in adaptation.flights(data).items():
            rmse, anees = adaptation.errors(flown, config, range(few))
            print(f" {name} {rmse[0]:.3f}/{rmse[1]:.2f}/{rmse[2]:.3f} ({anees:.2f})", end="", flush=True)
        print()


def compare_with_peer(runs: int, _: Path | None) -> None:
    found = peer.side_by_side(range(max(runs // 50, 2)))
    ours, theirs = np.median(found.ours_s), np.median(found.theirs_s)
    print(f"RMSE in m, ours {numbers(found.ours_m, 4)}, Stone Soup {numbers(found.theirs_m, 4)}", end=", ")
    print(f"furthest apart {found.furthest_m:.4f} m")
    print(f"step (two readings, two pixels): {1e3 * ours:.3f} ms and {1e3 * theirs:.3f} ms, {theirs / ours:.1f} x")


SECTIONS = {
    "bounds": bounds,
    "gain": gain,
    "pipeline": pipeline,
    "reference": reference,
    "overlap": three_stations,
    "clocks": clocks,
    "consider": consider,
    "outliers": outliers,
    "borders": borders,
    "modes": modes,
    "peer": compare_with_peer,
}


def main() -> None:
    """Print the sections that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("sections", nargs="*", metavar="SECTION", help=", ".join(SECTIONS))
    parser.add_argument("--runs", type=int, default=200)
    data = os.environ.get("GROUNDSTATION_DATA")
    parser.add_argument("--data", type=Path, default=None if data is None else Path(data))
    options = parser.parse_args()
    unknown = set(options.sections) - set(SECTIONS)
    if unknown:
        parser.error(f"no section {', '.join(sorted(unknown))}")
    for name in options.sections or SECTIONS:
        SECTIONS[name](options.runs, options.data)


if __name__ == "__main__":
    main()
