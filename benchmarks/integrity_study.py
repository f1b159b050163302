"""Integrity of approaches: misleading ones counted, their probability, false wave-offs, and what they are bounded by.

usage: python benchmarks/integrity_study.py [--approaches N] [--flights N] [--figure FILE] [--workers N] [SECTION …]

Sections: following, nature, faulty, risk, diagram, whole; all by default. Faults, priors and sites stand in
benchmarks/integrity_approaches/fault_list.py. Approaches are linear in noise and faults with the geometry, the levels
and the advice of groundstation.integrity; `whole` compares them with the pipeline. Figures in docs/notes/integrity.md.
"""

import argparse
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from groundstation.cli.start import ONE_THREAD

# products of small matrices: a second thread costs more than it brings
os.environ.update(ONE_THREAD | os.environ)

import numpy as np
from integrity_approaches import counts
from integrity_approaches.fault_list import SITES
from integrity_approaches.stanford import draw_stanford
from integrity_approaches.strata import NO_FAULT, TWO_AT_ONCE, approach_of, strata_of
from integrity_approaches.whole_filter import compared
from parallel_study import StudyRun, add_study_arguments, in_blocks
from scipy.stats import chi2

TWO = "two stations"
# approaches of a job, so that it takes some seconds
JOB = 20_000
# sizes of faults are drawn so many times as large where errors beyond the alert limits are counted, and for all others
FAR, NEAR = 4.0, 2.0
# so many times as many approaches with two faults: an error beyond the limits needs two sizes that go together
PAIR_PARTS = 16
MEASURES = (
    ("misleading", FAR, "P(misleading)"),
    ("exceeding", NEAR, "P(error beyond a level, no alarm)"),
    ("brute", NEAR, f"P(beyond {counts.BRUTE:g} of the limits while GO)"),
)
KINDS = (NO_FAULT, "detection of station left", "mount of station left", "clock of station left", "target point")


def jobs(site: str, n: int) -> dict[str, tuple[str, int, int]]:
    """Return jobs that together make n approaches."""
    sizes = [min(JOB, n - k) for k in range(0, n, JOB)]
    return {f"{site.replace(' ', '-').replace(',', '')}-{k}": (site, size, k) for k, size in enumerate(sizes)}


def summed(parts: list[dict[str, Any]], largest: tuple[str, ...] = ()) -> dict[str, Any]:
    """Return the sums of equal keys; the largest of those named."""
    return {key: (max if key in largest else sum)(p[key] for p in parts) for key in parts[0]}


def interval(count: int, n: int) -> str:
    """Return a share with its 95 % interval (Poisson)."""
    low = chi2.ppf(0.025, 2 * count) / 2 / n if count else 0.0
    high = chi2.ppf(0.975, 2 * count + 2) / 2 / n
    return f"{count / n:.2e} ({low:.2e} … {high:.2e})"


def following(_: argparse.Namespace, run: StudyRun) -> None:
    items = {name.replace(" ", "-").replace(",", ""): name for name in (TWO, "three stations")}
    for name, value in zip(items, run.values(counts.following, items).values(), strict=True):
        print(f"{name}: the filter follows a fault by at most {value:.3f} x one fix, half a second on")


def nature(options: argparse.Namespace, run: StudyRun) -> None:
    for site in SITES:
        n = options.approaches if site == TWO else options.approaches // 10
        total = summed(list(run.values(counts.by_nature, jobs(site, n)).values()))
        free = total["fault_free"]
        print(
            f"{site}: {total['n']} approaches by their priors: {total['misleading']} misleading; "
            f"beyond a level {interval(total['exceeding'], total['n'])}; beyond {counts.BRUTE:g} of the limits "
            f"{interval(total['brute'], total['n'])}; without a fault {free}: alarms "
            f"{interval(total['false_alarms'], free)}, not GO at the end {interval(total['false_wave_offs'], free)}"
        )


def faulty(options: argparse.Namespace, run: StudyRun) -> None:
    for site in SITES:
        items = jobs(site, max(options.approaches // 10, 1000))
        total = summed(list(run.values(counts.with_a_fault, items).values()), ("slowest_s",))
        print(
            f"{site}: {total['n']} approaches with a fault each: {total['misleading']} misleading, of which "
            f"{total['unseen']} by what is not seen; an error beyond a limit at any time in {total['beyond']}, GO at "
            f"the end in {total['go']}; {total['certain']} sudden faults certain to be seen: {total['in_time']} called "
            f"within 0.5 s, the slowest after {total['slowest_s']:.2f} s"
        )


def risk(options: argparse.Namespace, run: StudyRun) -> None:
    n = max(options.approaches // 25, 1000)
    for site in SITES:
        items = {
            f"{site.replace(' ', '-').replace(',', '')}-{k}-{scale:g}-{part}": (site, s.name, n, 100 * k + part, scale)
            for k, s in enumerate(strata_of(site))
            for scale in (NEAR, FAR)
            for part in range(PAIR_PARTS if s.name == TWO_AT_ONCE and scale == FAR else 1)
        }
        parts = list(zip(items.values(), run.values(counts.importance, items).values(), strict=True))
        for measure, scale, words in MEASURES:
            print_risk(site, f"{site}: {words}", measure, [(i[1], found) for i, found in parts if i[4] == scale])
        far = [found for item, found in parts if item[4] == FAR]
        unseen, hits = sum(f["unseen"] for f in far), sum(f["misleading"][2] for f in far)
        free, table = approach_of(site).fault_free_risk(), SITES[site].config.faults
        print(f"   {unseen} of {hits:.0f} drawn misleading approaches by what is not seen; fault-free below {free:.0e}")
        both = table.two_at_once(SITES[site].rig.names)
        print(f"   risk {table.risk:g}, of which two faults at once take {both:.1e}")


def print_risk(site: str, words: str, measure: str, parts: list[tuple[str, dict[str, Any]]]) -> None:
    """Print the probability of a measure, its relative error, and the kinds that it comes from."""
    means, variance = {}, 0.0
    for s in strata_of(site):
        own = [found for name, found in parts if name == s.name]
        n = sum(f["n"] for f in own)
        weight, square = (sum(f[measure][k] for f in own) for k in range(2))
        means[s.name] = s.prior * weight / n
        variance += s.prior**2 * max(square / n - (weight / n) ** 2, 0.0) / n
    total = sum(means.values())
    relative = variance**0.5 / total if total else float("nan")
    print(f"{words} {total:.2e}, relative error (1 sigma) {100 * relative:.0f} %")
    largest = sorted(means.items(), key=lambda pair: -pair[1])[:5]
    print("   " + ", ".join(f"{name} {mean:.1e}" for name, mean in largest if mean > 0.0))


def diagram(options: argparse.Namespace, run: StudyRun) -> None:
    n = max(options.approaches // 500, 20)
    items = {f"{k}": (TWO, min(n, 200), k) for k in range(10)}
    total = np.sum([np.array(part) for part in run.values(counts.diagram, items).values()], axis=0)
    levels = (np.arange(counts.DIAGRAM_CELLS) + 0.5) * counts.DIAGRAM_LIMITS / counts.DIAGRAM_CELLS
    for axis, name in enumerate(("along", "across", "up")):
        beyond = total[axis][levels[:, None] < levels[None, :]].sum()
        wrong = total[axis][(levels[:, None] < 1.0) & (levels[None, :] > 1.0)].sum()
        print(
            f"{TWO}, {name}: {total[axis].sum():.0f} pairs, error beyond the level {beyond:.0f}, misleading {wrong:.0f}"
        )
    if options.figure is not None:
        options.figure.write_bytes(draw_stanford(total))
        print(f"wrote {options.figure}")


def whole(options: argparse.Namespace, run: StudyRun) -> None:
    items = {
        f"{kind.replace(' ', '-')}-{k}": (TWO, kind, seeds)
        for kind in KINDS
        for k, seeds in enumerate(in_blocks(range(options.flights), 20))
    }
    found = run.values(compared, items)
    for kind in KINDS:
        rows = [row for name, part in found.items() if items[name][1] == kind for row in part]
        texts = []
        for way in ("linear", "pipeline"):
            mine = [row[way] for row in rows]
            alarms = sum(r["alarmed"] for r in mine)
            beyond = sum(r["exceeding"] > 1.0 for r in mine)
            wrong = sum(r["misleading"] > 1.0 for r in mine)
            share = np.median([r["share"] for r in mine])
            texts.append(
                f"{way}: alarms {alarms}, beyond a level {beyond}, misleading {wrong}, error/level {share:.3f}"
            )
        print(f"{TWO}, {kind}, {len(rows)} flights, " + "; ".join(texts))


SECTIONS: dict[str, Callable[[argparse.Namespace, StudyRun], None]] = {
    "following": following,
    "nature": nature,
    "faulty": faulty,
    "risk": risk,
    "diagram": diagram,
    "whole": whole,
}


def main() -> None:
    """Print the sections that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("sections", nargs="*", metavar="SECTION", help=", ".join(SECTIONS))
    parser.add_argument(
        "--approaches", type=int, default=300_000, metavar="N", help="drawn by their priors, two stations"
    )
    parser.add_argument("--flights", type=int, default=40, metavar="N", help="through the pipeline, of each kind")
    parser.add_argument("--figure", type=Path, metavar="FILE", help="where the Stanford diagram is written, PNG")
    add_study_arguments(parser, "integrity")
    options = parser.parse_args()
    unknown = set(options.sections) - set(SECTIONS)
    if unknown:
        parser.error(f"no section {', '.join(sorted(unknown))}")
    if options.approaches < 1000 or options.flights < 1:
        parser.error("--approaches wants 1000 or more, --flights 1 or more")
    for name in options.sections or SECTIONS:
        SECTIONS[name](options, StudyRun.chosen(f"integrity {name}", options))


if __name__ == "__main__":
    main()
