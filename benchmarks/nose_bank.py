"""Runway edges in drawn approaches: errors, misleading frames, coverage by contrast, each factor's share of harm.

    python benchmarks/nose_bank.py [--set train|validate|test] [--first N] [--count N] [--pictures N] [--shoulders M]
        [--workers N]

Each seed draws an airfield, a light, a camera with its mount, a flight and a unit (`draw_nose_world`; the pictures of
one: `groundstation onboard render --world SEED`), and `onboard edges` runs on its pictures. From `--first 500000` on
the ground is as bright as pavement or brighter. Only pictures count in which the runway is seen in eight rows at least.
*Served*: tracking, and no end beyond 2 px. *Misleading*: tracking, and
an end beyond five stated sigmas. Harm: by how much the share of served frames would rise if the class had that of all
others.
"""

import argparse
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from nose_study.drawn import scored_world
from parallel_study import StudyRun, add_study_arguments

from groundstation.simulation.world.world_sets import WorldSet, seed_of

SERVED_PX, MISLEADING, COVERED = 2.0, 5.0, 3.0
CONTRASTS = ((0.0, 0.5), (0.5, 1.0), (1.0, 2.0), (2.0, math.inf))
# until a pair is confirmed there is nothing to track
CONFIRMED_FROM = 4
Row = dict[str, Any]


def off_px(row: Row) -> float:
    """Return how far off the worst end is, px; infinite without edges."""
    return float(np.abs(row["errors"]).max()) if "errors" in row else math.inf


def off_sigmas(row: Row) -> float:
    """Return the same in stated sigmas."""
    return float((np.abs(row["errors"]) / np.array(row["sigmas"])).max())


def tracks(row: Row) -> bool:
    """Return whether the status is tracking."""
    return bool(row["status"] == "tracking")


def served(row: Row) -> bool:
    """Return whether a picture has edges that help."""
    return tracks(row) and off_px(row) <= SERVED_PX


def rms_of(rows: list[Row]) -> float:
    """Return the root mean square of the ends of tracking frames, px; NaN without any."""
    errors = [row["errors"] for row in rows if tracks(row)]
    return float(np.sqrt(np.mean(np.square(errors)))) if errors else math.nan


def line_of(name: str, rows: list[Row], more: str = "") -> str:
    """Return a table's line of some frames."""
    tracking = [row for row in rows if tracks(row)]
    count = len(tracking)
    misleading = sum(off_sigmas(row) > MISLEADING for row in tracking)
    covered = sum(off_sigmas(row) <= COVERED for row in tracking) / count if count else math.nan
    nees = float(np.mean([row["nees"] for row in tracking])) if count else math.nan
    share = f"{count / len(rows):.0%}" if rows else "-"
    return (
        f"| {name} | {len(rows)} | {share} | {rms_of(rows):.2f} | {covered:.2%} | {misleading} of {count} "
        f"| {nees:.2f} |{more}"
    )


def harm_of(worlds: list[Row], inside: Callable[[Row], bool]) -> float:
    """Return by how much the share of served frames would rise if a class of worlds had that of all others."""
    own = [served(row) for world in worlds if inside(world) for row in world["rows"]]
    others = [served(row) for world in worlds if not inside(world) for row in world["rows"]]
    if not own or not others:
        return 0.0
    whole = len(own) + len(others)
    return float(np.mean(others) - np.mean(own)) * len(own) / whole


def report(worlds: list[Row]) -> None:
    """Print the figures."""
    for world in worlds:
        world["rows"] = [row for row in world["rows"] if row["picture"] >= CONFIRMED_FROM]
    rows = [row for world in worlds for row in world["rows"]]
    medians = [rms_of(world["rows"]) for world in worlds if any(tracks(row) for row in world["rows"])]
    print(f"{len(worlds)} approaches, {len(medians)} with frames that track, {len(rows)} frames that show the runway")
    print(f"rms of an approach: median {np.median(medians):.2f} px, 90 % {np.quantile(medians, 0.9):.2f} px")
    sizes = [off_px(row) for row in rows if tracks(row)]
    print(f"worst end of a frame: median {np.median(sizes):.2f} px; beyond {SERVED_PX} px: "
          f"{np.mean(np.array(sizes) > SERVED_PX):.1%}")  # fmt: skip
    print("| frames | shown | tracking | rms px | within 3 sigmas | misleading | NEES |\n|---|---|---|---|---|---|---|")
    print(line_of("all", rows))
    for low, high in CONTRASTS:
        name = f"contrast {low:g} to {high:g}" if math.isfinite(high) else f"contrast from {low:g}"
        print(line_of(name, [row for row in rows if low <= row["contrast"] < high]))
    print("\n| factor | class | approaches | shown | tracking | rms px | within 3 sigmas | misleading | NEES | harm |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    found = []
    for factor in (one for one in worlds[0]["factors"] if all(one in world["factors"] for world in worlds)):
        for kind in sorted({world["factors"][factor] for world in worlds}):
            own = [world for world in worlds if world["factors"][factor] == kind]
            harm = harm_of(worlds, lambda world, factor=factor, kind=kind: world["factors"][factor] == kind)  # type: ignore[misc]
            own_rows = [row for world in own for row in world["rows"]]
            found.append((harm, line_of(f"{factor} | {kind} | {len(own)}", own_rows, f" {harm:+.1%} |")))
    for _, line in sorted(found, key=lambda pair: -pair[0]):
        print(line)
    for world in worlds:
        wrong = sum(off_sigmas(row) > MISLEADING for row in world["rows"] if tracks(row))
        if wrong:
            print(f"misleading: seed {world['seed']}: {wrong} of {len(world['rows'])} frames")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--set", choices=[one.value for one in WorldSet], default=WorldSet.VALIDATE.value)
    parser.add_argument("--first", type=int, default=0, help="number of the first world in its set")
    parser.add_argument("--count", type=int, default=40, help="number of approaches")
    parser.add_argument("--pictures", type=int, default=24, help="of each")
    parser.add_argument("--shoulders", type=float, default=0.0, metavar="M", help="paved shoulders, darker by a fifth")
    add_study_arguments(parser, "nose-bank")
    options = parser.parse_args()
    seeds = [seed_of(WorldSet(options.set), options.first + k) for k in range(options.count)]
    job = {"pictures": options.pictures} | ({"shoulders_m": options.shoulders} if options.shoulders else {})
    jobs = {str(seed): {"seed": seed, **job} for seed in seeds}
    report(list(StudyRun.chosen("nose bank", options).values(scored_world, jobs).values()))


if __name__ == "__main__":
    main()
