"""Ratio of the error of a live run to that of a replay of the same rendered flight; required: at most 1.3.

    python benchmarks/live_against_replay.py [--rate HZ] [--runs N] [--virtual]

One approach of `groundstation live --simulate`: the same aircraft, rig, scenery and rate are filmed into a session
(heads that follow it perfectly informed, every pair there, lossless) and replayed; and flown live, on ptys and in real
time, where this machine leaves pairs out as it must; with --virtual in virtual time, where none is. Both against the
same truth. RMSE in m by range, x/y/z, and the ratio live to replay of each, over all runs.
"""

import argparse
import csv
import itertools
import math
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from groundstation.geometry.rotation import rotation_from_vector, wxyz_from_matrix
from groundstation.live.command import LiveRequest, live
from groundstation.replay.replay import ReplayRequest, replay
from groundstation.rig.rig import Rig
from groundstation.rig.rig_toml import rig_to_toml
from groundstation.simulation.closed_loop import ClosedLoopConfig
from groundstation.simulation.closed_loop_rendered import RenderedClosedLoopSimulation
from groundstation.simulation.flights import rendered_scenario
from groundstation.simulation.picture_writer import PictureFormat
from groundstation.simulation.rendered_camera import RenderedCamera
from groundstation.simulation.rendered_scene import RenderedScene
from groundstation.simulation.rendered_session_folder import write_rendered_session
from groundstation.simulation.repeated_landings import SPAN_M, RepeatedLandings
from groundstation.simulation.simulate import simulate
from groundstation.simulation.simulated_station import SimulatedStation, SimulatedStationConfig
from groundstation.simulation.standard_cases import standard_rig
from groundstation.tracking.config import Config

APPROACH_S = 23.0
BINS_M = (100.0, 250.0, 400.0, 560.0)
ASKED = 1.3


def table(path: Path, begin_s: float) -> np.ndarray:
    """Return t, x, y, z of all rows of a track.csv, (n, 4), from the flight's time zero on."""
    with path.open(encoding="utf-8") as file:
        rows = [r for r in csv.DictReader(file) if r["x_m"]]
    return np.array([[float(r["t_s"]) - begin_s, *(float(r[f"{a}_m"]) for a in "xyz")] for r in rows]).reshape(-1, 4)


def drawn_rig(seed: int) -> Rig:
    """Return the standard rig, each station turned by a drawn part of its encoder's step, as stated in the rig file.

    Two stations that mirror each other, before an aircraft that flies between them and heads that follow perfectly,
    have steps of the encoders that come at the same instants, and whose errors cancel in x: no site is like that.
    """
    random = np.random.default_rng([seed, 31])
    stations = []
    for station in standard_rig().stations:
        turn = rotation_from_vector(np.array([0.0, 0.0, random.uniform(-0.5, 0.5) * station.ptu_resolution_rad]))
        stations.append(replace(station, runway_from_base_wxyz=wxyz_from_matrix(turn)))
    return Rig(stations=tuple(stations))


def replayed(folder: Path, rate_hz: float, seed: int) -> np.ndarray:
    """Film the approach, replay it, return its track."""
    flight, rig = RepeatedLandings(APPROACH_S), drawn_rig(seed)
    world = RenderedScene(trajectory=flight)
    cameras = {s.name: RenderedCamera(world, s, seed=seed, number=n) for n, s in enumerate(rig.stations)}
    flown = simulate(rendered_scenario(flight, rig, seed=seed, frame_hz=rate_hz))
    session = folder / "session"
    write_rendered_session(session, flown, cameras, words={"name": "approach"}, form=PictureFormat.LOSSLESS)
    (session / "dgps.csv").unlink()
    replay(ReplayRequest(session=session, out=folder / "replayed", rerun=False))
    return table(folder / "replayed" / "track.csv", 0.0)


def flown_live(folder: Path, rate_hz: float, seed: int) -> np.ndarray:
    """Fly the approach in real time, return its track."""
    rig = folder / "rig.toml"
    rig.write_text(rig_to_toml(drawn_rig(seed)), encoding="utf-8")
    request = LiveRequest(station=None, out=folder / "live", seconds=APPROACH_S)
    simulator = SimulatedStation(SimulatedStationConfig(seconds=APPROACH_S, rig=rig, rate_hz=rate_hz, seed=seed))
    result = live(request, lambda: False, lambda status: None, lambda text: None, simulator)
    print(f"  live: {result.operation.epochs} pairs answered, {dict(result.operation.dropped)}", flush=True)
    return table(folder / "live" / "track.csv", result.begin_s)


def rehearsed(rate_hz: float, seed: int) -> np.ndarray:
    """Fly the approach in virtual time, return its track."""
    hardware = ClosedLoopConfig(frame_rate_hz=rate_hz)
    day = RenderedClosedLoopSimulation(
        drawn_rig(seed), Config(), RepeatedLandings(APPROACH_S), hardware=hardware, seed=seed, span_m=SPAN_M
    ).run()
    rows = [(e.t_s, *e.kinematics.position_runway_m) for e in day.estimates if e.kinematics is not None]
    return np.array(rows).reshape(-1, 4)


def errors(answers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the errors (n, 3) of the estimates during the approach, and the true range of each."""
    inside = (answers[:, 0] >= 0.0) & (answers[:, 0] < APPROACH_S)
    truth = RepeatedLandings(APPROACH_S).position(answers[inside, 0])
    return answers[inside, 1:] - truth, truth[:, 1]


def rms(runs: list[tuple[np.ndarray, np.ndarray]], low_m: float, high_m: float) -> np.ndarray:
    """Return the RMSE (3,) of all runs in a bin of range; NaN without data."""
    chosen = [e[(y >= low_m) & (y < high_m)] for e, y in runs]
    together = np.concatenate(chosen)
    return np.sqrt((together**2).mean(axis=0)) if len(together) else np.full(3, math.nan)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rate", type=float, default=15.0)
    parser.add_argument("--runs", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--virtual", action="store_true", help="live in virtual time, whatever the machine")
    options = parser.parse_args()
    alive, leisurely = [], []
    for seed in range(options.seed, options.seed + options.runs):
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            leisurely.append(errors(replayed(folder, options.rate, seed)))
            answers = rehearsed(options.rate, seed) if options.virtual else flown_live(folder, options.rate, seed)
            alive.append(errors(answers))
    print(f"{options.runs} approaches, {options.rate:g} pairs/s, {'virtual' if options.virtual else 'real'} time")
    print(f"{'y [m]':>8s} {'replay x/y/z':>20s} {'live x/y/z':>20s} {'ratio x/y/z':>16s}")
    worst = 0.0
    for low, high in [*itertools.pairwise(BINS_M), (BINS_M[0], BINS_M[-1])]:
        theirs, ours = rms(leisurely, low, high), rms(alive, low, high)
        ratio = ours / theirs
        words = ["/".join(f"{v:.3f}" for v in values) for values in (theirs, ours)]
        print(f"{low:3.0f}–{high:<4.0f} {words[0]:>20s} {words[1]:>20s} " + "/".join(f"{v:.2f}" for v in ratio))
        worst = float(ratio.max())
    print(f"asked: ≤ {ASKED:g} over the whole approach; the largest of the three axes is {worst:.2f}")


if __name__ == "__main__":
    main()
