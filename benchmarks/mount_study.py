"""`groundstation calibrate mount` on made-up heads: do errors come true, and how many sightings does it take?

    python benchmarks/mount_study.py [--rigs 120]

Heads with every error that is sought (0.3° boresight and base, 1 cm lever arm, 300 ppm scales, 0.05° lean, backlash
up to 0.06°), encoders of 0.01° noise and 0.00625° steps, pixels of 0.3 px, twelve marks of known place or direction
over pan ±60° and tilt −10 to 58°, each place approached from either side. First the bound on the boresight by where
marks are, and the grid of docs/calibration.md, with encoders whose step is all their noise, too.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
from scipy.stats import chi2

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from calibration.information import inverse
from calibration.mount.calibrate import calibrate_station
from calibration.mount.covariance import information
from calibration.mount.parameters import USUAL_WORDS, choose_mount
from calibration.mount.pointing import pointing_sigma
from calibration.mount.problem import MountProblem
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
COUNTS = (50, 100, 200, 400, 800, 1600, 6400)


def pointing_error(found: Station, true: Station) -> np.ndarray:
    """Return how far the camera looks from where the found rig says, degrees of pan and tilt, where a station works."""
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


def chi_squares(rigs: int, sightings: int) -> None:
    errors: dict[str, list[float]] = {}
    sigmas: dict[str, list[float]] = {}
    for seed in range(rigs):
        rng = np.random.default_rng([5, seed])
        station = plain_station()
        true = spoiled(station, rng)
        marks = marks_around(true, rng)
        one = calibrate_station(station, look(true, marks, rng, sightings), marks, USUAL_WORDS)
        for name, off in off_by(one.after, true).items():
            if name in one.fit.problem.names:
                errors.setdefault(name, []).append(off)
                sigmas.setdefault(name, []).append(one.fit.sigma(name))
    print(f"{rigs} heads, {sightings} sightings each: errors over claimed sigmas")
    print(f"{'parameter':<22}{'heads':>6}{'rms error':>12}{'rms sigma':>12}{'chi2/n':>8}   99.8 % of such")
    for name, off in errors.items():
        n, z = len(off), np.array(off) / sigmas[name]
        scale = 1e6 if "scale" in name else 1e3 if "camera" in name and "head_from" not in name else np.degrees(1.0)
        unit = "ppm" if "scale" in name else "mm" if scale == 1e3 else "deg"
        low, high = chi2.ppf([0.001, 0.999], n) / n
        rms = [scale * np.sqrt(np.mean(np.square(v))) for v in (off, sigmas[name])]
        print(f"{name:<22}{n:>6}{rms[0]:>12.4f}{rms[1]:>12.4f}{np.mean(z**2):>8.2f}   {low:.2f} to {high:.2f}  {unit}")


def counts(rigs: int) -> None:
    print(f"\nrms over {rigs} heads, degrees")
    print("sightings  boresight x    y       z     looks off, pan  tilt   claimed, pan  tilt   held-out px over noise")
    for sightings in COUNTS:
        off, point, claimed, held = [], [], [], []
        for seed in range(rigs):
            rng = np.random.default_rng([6, sightings, seed])
            station = plain_station()
            true = spoiled(station, rng)
            marks = marks_around(true, rng)
            one = calibrate_station(station, look(true, marks, rng, sightings), marks, USUAL_WORDS)
            found = off_by(one.after, true)
            off.append([np.degrees(found[f"head_from_camera.{axis}"]) for axis in "xyz"])
            point.append(pointing_error(one.after, true))
            at = pointing_sigma(one.fit)
            claimed.append((at.pan_deg, at.tilt_deg))
            if one.fit.held_out is not None:
                held.append(one.fit.held_out.rms_px / one.fit.held_out.noise_px)
        x, y, z = np.sqrt(np.mean(np.square(off), axis=0))
        pan, tilt = np.sqrt(np.mean(np.square(point), axis=0))
        reported = np.sqrt(np.mean(np.square(claimed), axis=0))
        ratio = f"{np.mean(held):.3f}" if held else "-"
        print(
            f"{sightings:>9}  {x:>9.4f} {y:>7.4f} {z:>7.4f} {pan:>12.4f} {tilt:>8.4f}"
            f" {reported[0]:>11.4f} {reported[1]:>8.4f} {ratio:>12}",
            flush=True,
        )


def bounds(rigs: int) -> None:
    """Print the bound on the boresight of 400 sightings, by where the marks stand and where in the picture they are."""
    print(f"\nbound on the boresight from 400 sightings over {rigs} heads, degrees; sightings for {ASKED_DEG} deg")
    for tilts in (LOW_DEG, GRID_TILTS_DEG):
        for in_corners in (False, True):
            variances = []
            for seed in range(rigs):
                rng = np.random.default_rng([9, seed])
                true = spoiled(plain_station(), rng)
                marks = marks_around(true, rng, tilts_deg=tilts)
                seen = look(true, marks, rng, 400, in_corners=in_corners)
                free = choose_mount(true, marks, USUAL_WORDS)
                prior = np.array(list(free.values()))
                problem = MountProblem(station=true, sightings=seen, marks=marks, names=tuple(free), prior_sigma=prior)
                known = information(problem, np.zeros(len(prior)), np.ones(len(seen), dtype=np.bool_))
                with np.errstate(divide="ignore"):
                    covariance = inverse(known + np.diag(1.0 / prior**2))
                places = [problem.names.index(f"head_from_camera.{axis}") for axis in "xyz"]
                variances.append(np.diag(covariance)[places])
            sigma = np.degrees(np.sqrt(np.mean(variances, axis=0)))
            needed = 400 * (sigma / ASKED_DEG) ** 2
            where = "near the corners" if in_corners else "anywhere in the picture"
            print(
                f"  tilts {tilts}, {where}: "
                + ", ".join(f"{s:.4f} ({n:.0f})" for s, n in zip(sigma, needed, strict=True))
            )


def designed(rigs: int, noise_deg: float) -> None:
    """Print errors by the grid that the documentation asks for, encoders of steps and this noise."""
    errors: dict[str, list[float]] = {}
    sigmas: dict[str, list[float]] = {}
    together, free = [], 0
    for seed in range(rigs):
        head = head_on_the_grid(np.random.default_rng([10, seed]), GRID_ROWS, noise_deg)
        one = calibrate_station(head.station, head.seen, head.marks, USUAL_WORDS)
        names = one.fit.problem.names
        off = {name: value for name, value in off_by(one.after, head.true).items() if name in names}
        for name, value in off.items():
            errors.setdefault(name, []).append(value)
            sigmas.setdefault(name, []).append(one.fit.sigma(name))
        places = [names.index(name) for name in off]
        all_of_them = np.array(list(off.values()))
        together.append(all_of_them @ np.linalg.solve(one.fit.covariance[np.ix_(places, places)], all_of_them))
        free += len(off)
    print(
        f"\n{rigs} heads, {GRID_STANDSTILLS} standstills of {GRID_ROWS} rows near the picture's corners, tilts"
        f" {GRID_TILTS_DEG}, steps of {STEP_DEG}° and noise of {noise_deg}°"
    )
    for axis in "xyz":
        name = f"head_from_camera.{axis}"
        rms, reported = (np.degrees(np.sqrt(np.mean(np.square(v[name])))) for v in (errors, sigmas))
        print(f"  boresight {axis}: rms {rms:.5f} deg, sigma {reported:.5f} deg")
    for name, values in errors.items():
        n = len(values)
        low, high = chi2.ppf([0.001, 0.999], n) / n
        print(f"  {name:<22} chi2/n {np.mean(np.square(np.array(values) / sigmas[name])):.2f}, {low:.2f} to {high:.2f}")
    low, high = chi2.ppf([0.001, 0.999], free) / rigs
    print(f"  all together {np.mean(together):.2f} of {free / rigs:.2f}, 99.8 %: {low:.2f} to {high:.2f}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rigs", type=int, default=120)
    options = parser.parse_args()
    bounds(3)
    for noise_deg in (NOISE_DEG, 0.0):
        designed(options.rigs, noise_deg)
    chi_squares(options.rigs, 300)
    counts(max(options.rigs // 6, 3))


if __name__ == "__main__":
    main()
