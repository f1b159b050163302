"""Replays with rigs calibrated by a flight: a real hexacopter, and rendered sessions with a perturbed rig.

usage: python benchmarks/calibrated_replays.py [--data FOLDER] [SECTION …]

Sections: `drone` (drone-flight-3: calibrated up to 342 s, the EKF from 345 s on against RTK, four stations and all
six pairs), `positions` (the same with no position known), `spoilt` (landing-1 with mounts off by 0.1 deg, takeoff-1
with PTU clocks off by 40 ms: calibrated by one part of the flight, evaluated on the rest, which is not used). Figures
in docs/notes/calibration.md.
"""

import argparse
import csv
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from drawn_rigs import unit_of

from calibration.flight.calibrate import FlightRequest, calibrate_flight
from groundstation.evaluation.config import EvaluationConfig
from groundstation.evaluation.position_series import interpolate, reference_from_fixes
from groundstation.evaluation.reference_exclusion import covers, find_glitches
from groundstation.replay.replay import ReplayRequest, replay
from groundstation.rig.covariance import ParameterCovariance
from groundstation.rig.rig import ClockModel, Rig, load_rig
from groundstation.rig.rig_toml import rig_to_toml
from groundstation.session import load_session
from groundstation.session.references import load_dgps

ROOT = Path(__file__).resolve().parent.parent
HEXACOPTER = ROOT / "docs" / "hexacopter.toml"
PAIRS = tuple(combinations(("gopro3", "sony5n", "sony5100", "sonyG"), 2))
TAUGHT_UNTIL_S, JUDGED_FROM_S = 342.0, 345.0
MOUNTS_DEG = {"left": (0.1, 0.0, 0.1), "right": (-0.1, 0.0, -0.1)}
CLOCK_S = 0.04


@dataclass(frozen=True, slots=True, kw_only=True)
class Split:
    """A rendered session with a perturbed rig: ``free`` is estimated in one interval, the track tested in another."""

    session: Path
    free: str
    taught_s: tuple[float | None, float | None]
    judged_s: tuple[float | None, float | None]


def splits(data: Path) -> tuple[Split, ...]:
    """Return the splits of landing-1 and takeoff-1; the take-off has DGPS from 6.05 s on."""
    landing, takeoff = ROOT / "recordings" / "landing-1", data / "takeoff-1"
    return (
        Split(session=landing, free="orientation", taught_s=(None, 20.0), judged_s=(20.0, None)),
        Split(session=takeoff, free="ptu_clock", taught_s=(6.05, None), judged_s=(None, 6.05)),
        Split(session=takeoff, free="ptu_clock", taught_s=(None, 9.0), judged_s=(9.0, None)),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackError:
    """Distances (n,) in m between track and reference while tracking, and the omissions of the reference.

    ``squares`` (n,) are those distances in sigmas of the stated covariance, squared and per axis.
    """

    off_m: np.ndarray
    squares: np.ndarray
    left_out: tuple[str, ...]

    @property
    def rmse_m(self) -> float:
        """Root mean square distance, m."""
        return float(np.sqrt(np.mean(self.off_m**2)))

    @property
    def anees(self) -> float:
        """Mean of ``squares``: 1 where the covariance is true."""
        return float(np.mean(self.squares))


def track_error(session: Path, results: Path, status: str = "tracking") -> TrackError:
    """Compare track.csv with DGPS in one clock, without the fixes that leave their own path."""
    reference = reference_from_fixes(load_dgps(load_session(session)))
    glitches = find_glitches(reference, EvaluationConfig())
    with (results / "track.csv").open() as stream:
        rows = [row for row in csv.DictReader(stream) if row["status"] == status and row["x_m"]]
    t = np.array([float(row["t_s"]) for row in rows])
    at = np.array([[float(row[f"{axis}_m"]) for axis in "xyz"] for row in rows])
    good = interpolate(reference.keep(~covers(glitches, reference.t_s)), t, 0.5)
    off = (at - good.position_m)[good.usable]
    names = [["".join(sorted(a + b)) for b in "xyz"] for a in "xyz"]
    covariance = np.array([[[float(row[f"cov_{n}_m2"]) for n in line] for line in names] for row in rows])[good.usable]
    squares = np.einsum("ni,ni->n", off, np.linalg.solve(covariance, off[:, :, None])[:, :, 0]) / 3.0
    inside = [g for g in glitches if t.min() <= g.from_s <= t.max()]
    return TrackError(
        off_m=np.linalg.norm(off, axis=1),
        squares=squares,
        left_out=tuple(f"{g.from_s:.1f} s: {g.detail}" for g in inside),
    )


def of_stations(rig: Rig, names: Sequence[str]) -> Rig:
    """Return a rig of some stations, each with its own covariance."""
    return replace(rig, stations=tuple(rig[name] for name in names), shared_covariance=ParameterCovariance.nothing())


def without_positions(session: Path, folder: Path) -> Path:
    """Copy a session whose stations do not know where they are."""
    folder.mkdir()
    for path in session.iterdir():
        if path.is_file() and path.name != "rig.toml":
            (folder / path.name).write_bytes(path.read_bytes())
    lines = (session / "rig.toml").read_text().replace('known = ["position"]', "known = []").splitlines()
    (folder / "rig.toml").write_text("\n".join(x for x in lines if not x.startswith("ptu_position_m")) + "\n")
    return folder


def spoilt_mounts(rig: Rig) -> Rig:
    """Return a rig whose mounts are off by 0.1 deg in tilt and pan, and that admits it."""
    stations = []
    for station in rig.stations:
        change = np.zeros(21)
        change[:3] = np.radians(MOUNTS_DEG[station.name])
        names = tuple(f"runway_from_base.{axis}" for axis in "xyz")
        spread = np.radians(0.1) ** 2 * np.eye(3)
        stations.append(replace(station.changed(change), covariance_parameters=names, covariance=spread))
    return replace(rig, stations=tuple(stations))


def spoilt_clocks(rig: Rig) -> Rig:
    """Return a rig whose PTU clocks are off by 40 ms and that does not know it."""
    return replace(
        rig,
        stations=tuple(
            replace(s, ptu_clock=ClockModel(offset_s=s.ptu_clock.offset_s + CLOCK_S, sigma_s=s.ptu_clock.sigma_s))
            for s in rig.stations
        ),
    )


def truth_rmse(session: Path, results: Path) -> np.ndarray:
    """Return the EKF's RMSE (3,) against the exact truth, m."""
    truth = np.genfromtxt(session / "truth.csv", delimiter=",", names=True)
    with (results / "track.csv").open() as stream:
        rows = [row for row in csv.DictReader(stream) if row["status"] == "tracking"]
    t = np.array([float(row["t_s"]) for row in rows])
    at = np.array([[float(row[f"{axis}_m"]) for axis in "xyz"] for row in rows])
    true = np.column_stack([np.interp(t, truth["t_s"], truth[f"{axis}_m"]) for axis in "xyz"])
    return np.sqrt(np.mean((at - true) ** 2, axis=0))


def spoilt_rig(split: Split) -> Rig:
    """Return the rig with wrong mounts or clocks."""
    rig = load_rig(split.session / "rig.toml")
    return spoilt_mounts(rig) if split.free == "orientation" else spoilt_clocks(rig)


def by_pixels(session: Path, detections: Path, folder: Path) -> Path:
    """Copy a session with the pixels that a replay of it has found, in place of its videos."""
    folder.mkdir()
    for path in session.iterdir():
        if path.name in ("session.toml", "rig.toml", "ptu.csv", "dgps.csv", "truth.csv"):
            (folder / path.name).write_bytes(path.read_bytes())
    with detections.open() as stream:
        rows = [row for row in csv.DictReader(stream) if row["status"] == "ok"]
    lines = [",".join(row[c] for c in ("t_s", "station", "u_px", "v_px")) for row in rows]
    (folder / "detections.csv").write_text("\n".join(["t_s,station,u_px,v_px", *lines]) + "\n")
    return folder


def replayed_as(session: Path, out: Path, rig: Path | None, **how: Any) -> Path:
    """Replay without pictures of it; return the folder of results."""
    replay(ReplayRequest(session=session, out=out, rig=rig, rerun=False, report=False, **how))
    return out


def drone(data: Path, work: Path) -> None:
    session = data / "drone-flight-3"
    found = calibrate_flight(FlightRequest(session=session, out=work / "rig.toml", to_s=TAUGHT_UNTIL_S)).rig
    for names in (found.names, *PAIRS):
        path = work / f"{len(names)}{names[0]}{names[1]}.toml"
        path.write_text(rig_to_toml(of_stations(found, names) if len(names) == 2 else found))
        for config in (None, HEXACOPTER):
            tuning = "as shipped" if config is None else config.name
            out = replayed_as(session, work / f"{path.stem}, {tuning}", path, from_s=JUDGED_FROM_S, config=config)
            error = track_error(session, out)
            print(f"{' + '.join(names)}, {tuning}: EKF while tracking {error.rmse_m:.3f} m RMSE in 3-D", end=", ")
            print(
                f"median {np.median(error.off_m):.3f} m, ANEES {error.anees:.2f}, {len(error.off_m)} epochs", end="; "
            )
            alone = track_error(session, out, "coasting")
            print(f"coasting {alone.rmse_m:.1f} m, ANEES {alone.anees:.2f}, {len(alone.off_m)} epochs", flush=True)
    for text in error.left_out:
        print("  left out:", text)


def positions(data: Path, work: Path) -> None:
    session = data / "drone-flight-3"
    folder = without_positions(session, work / "nowhere")
    found = calibrate_flight(FlightRequest(session=folder, out=work / "places.toml")).rig
    surveyed = load_rig(session / "rig.toml")
    for name in found.names:
        off = found[name].ptu_position_m - surveyed[name].ptu_position_m
        print(f"{name}: {np.linalg.norm(off):.3f} m from the survey, x y z", np.round(off, 3))


def spoilt(data: Path, work: Path) -> None:
    for k, split in enumerate(splits(data)):
        session, name = split.session, split.session.name
        assumed, found = work / f"{name}-assumed.toml", work / f"{name}-{k}-found.toml"
        assumed.write_text(rig_to_toml(spoilt_rig(split)))
        seen = work / f"{name}-before"
        if not seen.exists():
            replayed_as(session, seen, assumed)
        (taught, until), (first, last) = split.taught_s, split.judged_s
        fit = calibrate_flight(
            FlightRequest(
                session=session,
                rig=assumed,
                out=found,
                detections=seen / "detections.csv",
                from_s=taught,
                to_s=until,
                free=split.free,
            )
        ).fit
        print(f"{name}, taught {split.taught_s} s, judged {split.judged_s} s")
        for parameter, change, sigma in zip(fit.problem.names, fit.change, fit.sigma, strict=True):
            unit, scale = unit_of(parameter)
            print(f"  {parameter}: {scale * change:+.4f} ± {scale * sigma:.4f} {unit}")
        for label, rig in (("true rig", None), ("spoilt", assumed), ("found", found)):
            out = replayed_as(session, work / f"{name}-{k}-{label[0]}", rig, from_s=first, to_s=last)
            print(f"  {label}: EKF {'/'.join(f'{v:.3f}' for v in truth_rmse(session, out))} m", flush=True)


SECTIONS = {"drone": drone, "positions": positions, "spoilt": spoilt}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data")
    parser.add_argument("sections", nargs="*", metavar="SECTION", help="drone, positions, spoilt; all by default")
    options = parser.parse_args()
    if not options.data.is_dir():
        print(f"no recordings in {options.data}: nothing done")
        return
    for section in options.sections or SECTIONS:
        with tempfile.TemporaryDirectory() as folder:
            SECTIONS[section](options.data, Path(folder))


if __name__ == "__main__":
    main()
