"""`groundstation calibrate mount` on made-up heads: do errors come true, and how many sightings does it take?

    python benchmarks/mount_study.py [--rigs 120] [--workers N]

Heads with every error that is sought (0.3° boresight and base, 1 cm lever arm, 300 ppm scales, 0.05° lean, backlash
up to 0.06°), encoders of 0.01° noise and 0.00625° steps, pixels of 0.3 px, twelve marks of known place or direction
over pan ±60° and tilt −10 to 58°, each place approached from either side. First the bound on the boresight by where
marks are, and the grid of docs/calibration.md, with encoders whose step is all their noise, too.
"""

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np
from parallel_study import StudyRun, add_study_arguments, in_blocks
from scipy.stats import chi2

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from calibration.information import inverse
from calibration.mount.calibrate import StationMount, calibrate_station
from calibration.mount.covariance import information
from calibration.mount.parameters import USUAL_WORDS, choose_mount
from calibration.mount.pointing import pointing_sigma
from calibration.mount.problem import MountProblem
from groundstation.rig.covariance import ParameterCovariance
from groundstation.rig.rig import Station
from tests.calibration.mount.mounts import (
    GRID_ROWS,
    GRID_STANDSTILLS,
    GRID_TILTS_DEG,
    NOISE_DEG,
    STEP_DEG,
    head_on_the_grid,
    look,
    marks_around,
    off_by,
    plain_station,
    spoiled,
)

ASKED_DEG = 0.003
LOW_DEG = (-10.0, 10.0, 35.0, 58.0)
BOUND_HEADS, SIGHTINGS = 3, 300
# heads to a job: at most a minute, but for the most sightings
BLOCKS = {"bounds": 3, "designed": 5, "chi-squares": 10, "counts": 1}
COUNTS = (50, 100, 200, 400, 800, 1600, 6400)


def pointing_error(found: Station, true: Station) -> np.ndarray:
    """Return the camera's error of direction relative to the estimated rig, degrees of pan and tilt, in operation."""
    off = []
    for pan in np.radians((-30.0, 0.0, 30.0)):
        for tilt in np.radians((0.0, 7.5, 15.0)):
            for sense in (-1.0, 1.0):
                rays = []
                for station in (found, true):
                    u, v = station.lens.principal_point_px
                    angles = station.ptu_axes.angles(pan, tilt, sense, sense)
                    rays.append(station.geometry().ray(u, v, *angles).direction_runway)
                bearing = [(np.arctan2(-r[0], r[1]) * np.cos(tilt), np.arcsin(r[2])) for r in rays]
                off.append(np.degrees(np.subtract(*bearing)))
    return np.sqrt(np.mean(np.square(off), axis=0))


def calibrated(stream: tuple[int, ...], sightings: int) -> tuple[Station, StationMount]:
    """Return a drawn head as it is and as it is calibrated on sightings of marks around it."""
    rng = np.random.default_rng(list(stream))
    station = plain_station()
    true = spoiled(station, rng)
    marks = marks_around(true, rng)
    return true, calibrate_station(
        station, ParameterCovariance.nothing(), look(true, marks, rng, sightings), marks, USUAL_WORDS
    )


def errors_and_sigmas(one: StationMount, true: Station) -> dict[str, tuple[float, float]]:
    """Return error and stated sigma of the free parameters, by name."""
    names = one.fit.problem.names
    return {name: (float(off), one.fit.sigma(name)) for name, off in off_by(one.after, true).items() if name in names}


def by_name(heads: list[dict[str, tuple[float, float]]]) -> dict[str, np.ndarray]:
    """Return errors and sigmas (2, n) of all heads, by name."""
    found: dict[str, list[tuple[float, float]]] = {}
    for head in heads:
        for name, pair in head.items():
            found.setdefault(name, []).append(pair)
    return {name: np.array(pairs).T for name, pairs in found.items()}


def chi_squares(sightings: int, seeds: list[int]) -> list[dict[str, tuple[float, float]]]:
    """Return errors and sigmas of each head of a block."""
    heads = (calibrated((5, seed), sightings) for seed in seeds)
    return [errors_and_sigmas(one, true) for true, one in heads]


def show_chi_squares(heads: list[dict[str, tuple[float, float]]], sightings: int) -> None:
    print(f"{len(heads)} heads, {sightings} sightings each: errors over claimed sigmas")
    print(f"{'parameter':<22}{'heads':>6}{'rms error':>12}{'rms sigma':>12}{'chi2/n':>8}   99.8 % of such")
    for name, (off, sigmas) in by_name(heads).items():
        n, z = len(off), off / sigmas
        scale = 1e6 if "scale" in name else 1e3 if "camera" in name and "head_from" not in name else np.degrees(1.0)
        unit = "ppm" if "scale" in name else "mm" if scale == 1e3 else "deg"
        low, high = chi2.ppf([0.001, 0.999], n) / n
        rms = [scale * np.sqrt(np.mean(np.square(v))) for v in (off, sigmas)]
        print(f"{name:<22}{n:>6}{rms[0]:>12.4f}{rms[1]:>12.4f}{np.mean(z**2):>8.2f}   {low:.2f} to {high:.2f}  {unit}")


def counts(sightings: int, seeds: list[int]) -> list[dict[str, Any]]:
    """Return, of each head of a block, errors of boresight and pointing, their sigmas, and the held-out residual."""
    found = []
    for seed in seeds:
        true, one = calibrated((6, sightings, seed), sightings)
        off, at, held = off_by(one.after, true), pointing_sigma(one.fit), one.fit.held_out
        found.append(
            {
                "boresight": [np.degrees(off[f"head_from_camera.{axis}"]) for axis in "xyz"],
                "pointing": pointing_error(one.after, true).tolist(),
                "claimed": [at.pan_deg, at.tilt_deg],
                "held": None if held is None else held.rms_px / held.noise_px,
            }
        )
    return found


def show_counts(heads: list[dict[str, Any]], sightings: int) -> None:
    (x, y, z), (pan, tilt), reported = (
        np.sqrt(np.mean(np.square([head[key] for head in heads]), axis=0))
        for key in ("boresight", "pointing", "claimed")
    )
    held = [head["held"] for head in heads if head["held"] is not None]
    ratio = f"{np.mean(held):.3f}" if held else "-"
    print(
        f"{sightings:>9}  {x:>9.4f} {y:>7.4f} {z:>7.4f} {pan:>12.4f} {tilt:>8.4f}"
        f" {reported[0]:>11.4f} {reported[1]:>8.4f} {ratio:>12}"
    )


def bounds(tilts_deg: list[float], in_corners: bool, seeds: list[int]) -> list[list[float]]:
    """Return the least variances (3,) of the boresight from 400 sightings, for each head of a block."""
    variances = []
    for seed in seeds:
        rng = np.random.default_rng([9, seed])
        true = spoiled(plain_station(), rng)
        marks = marks_around(true, rng, tilts_deg=tuple(tilts_deg))
        seen = look(true, marks, rng, 400, in_corners=in_corners)
        free = choose_mount(true, ParameterCovariance.nothing(), marks, USUAL_WORDS)
        prior = np.array(list(free.values()))
        problem = MountProblem(station=true, sightings=seen, marks=marks, names=tuple(free), prior_sigma=prior)
        known = information(problem, np.zeros(len(prior)), np.ones(len(seen), dtype=np.bool_))
        with np.errstate(divide="ignore"):
            covariance = inverse(known + np.diag(1.0 / prior**2))
        places = [problem.names.index(f"head_from_camera.{axis}") for axis in "xyz"]
        variances.append(np.diag(covariance)[places].tolist())
    return variances


def show_bounds(variances: list[list[float]], tilts_deg: tuple[float, ...], in_corners: bool) -> None:
    """Print the bound on the boresight, by where the marks stand and where in the picture they are."""
    sigma = np.degrees(np.sqrt(np.mean(variances, axis=0)))
    needed = 400 * (sigma / ASKED_DEG) ** 2
    where = "near the corners" if in_corners else "anywhere in the picture"
    each = ", ".join(f"{s:.4f} ({n:.0f})" for s, n in zip(sigma, needed, strict=True))
    print(f"  tilts {tilts_deg}, {where}: {each}")


def designed(noise_deg: float, seeds: list[int]) -> list[tuple[dict[str, tuple[float, float]], float]]:
    """Return errors and sigmas of each head of a block on the grid of the documentation, and eᵀC⁻¹e of them."""
    found = []
    for seed in seeds:
        head = head_on_the_grid(np.random.default_rng([10, seed]), GRID_ROWS, noise_deg)
        one = calibrate_station(head.station, ParameterCovariance.nothing(), head.seen, head.marks, USUAL_WORDS)
        own = errors_and_sigmas(one, head.true)
        places = [one.fit.problem.names.index(name) for name in own]
        off = np.array([error for error, _ in own.values()])
        found.append((own, float(off @ np.linalg.solve(one.fit.covariance[np.ix_(places, places)], off))))
    return found


def show_designed(found: list[tuple[dict[str, tuple[float, float]], float]], noise_deg: float) -> None:
    """Print errors on the grid of the documentation, encoders with steps and this noise."""
    rigs, free = len(found), sum(len(own) for own, _ in found)
    print(
        f"\n{rigs} heads, {GRID_STANDSTILLS} standstills of {GRID_ROWS} rows near the picture's corners, tilts"
        f" {GRID_TILTS_DEG}, steps of {STEP_DEG}° and noise of {noise_deg}°"
    )
    values = by_name([own for own, _ in found])
    for axis in "xyz":
        rms, reported = (np.degrees(np.sqrt(np.mean(np.square(v)))) for v in values[f"head_from_camera.{axis}"])
        print(f"  boresight {axis}: rms {rms:.5f} deg, sigma {reported:.5f} deg")
    for name, (off, sigmas) in values.items():
        n = len(off)
        low, high = chi2.ppf([0.001, 0.999], n) / n
        print(f"  {name:<22} chi2/n {np.mean(np.square(off / sigmas)):.2f}, {low:.2f} to {high:.2f}")
    low, high = chi2.ppf([0.001, 0.999], free) / rigs
    together = np.mean([own for _, own in found])
    print(f"  all together {together:.2f} of {free / rigs:.2f}, 99.8 %: {low:.2f} to {high:.2f}")


def one_block(job: tuple[str, tuple[Any, ...]]) -> list[Any]:
    """Return the result of a part of the study on a block of heads."""
    part, arguments = job
    parts = {"bounds": bounds, "designed": designed, "chi-squares": chi_squares, "counts": counts}
    return list(parts[part](*arguments))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rigs", type=int, default=120)
    add_study_arguments(parser, "mount")
    options = parser.parse_args()
    few = max(options.rigs // 6, 3)
    where = [(tilts, in_corners) for tilts in (LOW_DEG, GRID_TILTS_DEG) for in_corners in (False, True)]
    # part, its case, and how many heads
    cases: list[tuple[str, tuple[Any, ...], int]] = [
        *(("bounds", case, BOUND_HEADS) for case in where),
        *(("designed", (noise_deg,), options.rigs) for noise_deg in (NOISE_DEG, 0.0)),
        ("chi-squares", (SIGHTINGS,), options.rigs),
        *(("counts", (sightings,), few) for sightings in COUNTS),
    ]
    jobs = {
        f"{part}-{number}-{block[0]}": (part, (*case, block))
        for number, (part, case, heads) in enumerate(cases)
        for block in in_blocks(range(heads), BLOCKS[part])
    }
    blocks = StudyRun.chosen("mounts", options).values(one_block, jobs)

    show = {"bounds": show_bounds, "designed": show_designed, "chi-squares": show_chi_squares, "counts": show_counts}
    headings = {
        "bounds": f"\nbound on the boresight from 400 sightings over {BOUND_HEADS} heads, degrees; "
        f"sightings for {ASKED_DEG} deg",
        "counts": f"\nrms over {few} heads, degrees\nsightings  boresight x    y       z     looks off, pan  tilt   "
        "claimed, pan  tilt   held-out px over noise",
    }
    for number, (part, case, heads) in enumerate(cases):
        if part in headings:
            print(headings.pop(part))
        names = (f"{part}-{number}-{block[0]}" for block in in_blocks(range(heads), BLOCKS[part]))
        show[part]([head for name in names for head in blocks[name]], *case)


if __name__ == "__main__":
    main()
