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


def estimate(found: dict[str, Any], measure: str) -> tuple[float, float]:
    """Return a probability given the kind of approach, and its variance."""
    weight, square, _ = found[measure]
    mean = weight / found["n"]
    return mean, max(square / found["n"] - mean**2, 0.0) / found["n"]


def risk(options: argparse.Namespace, run: StudyRun) -> None:
    n = max(options.approaches // 25, 1000)
    for site in SITES:
        strata = strata_of(site)
        short = site.replace(" ", "-").replace(",", "")
        items = {
            f"{short}-{k}-{scale:g}": (site, s.name, n, k, scale) for k, s in enumerate(strata) for scale in (NEAR, FAR)
        }
        found = run.values(counts.importance, items)
        for measure, scale in (("misleading", FAR), ("exceeding", NEAR), ("brute", NEAR)):
            parts = [estimate(found[f"{short}-{k}-{scale:g}"], measure) for k in range(len(strata))]
            means = [s.prior * p for s, (p, _) in zip(strata, parts, strict=True)]
            sigma = float(np.sqrt(sum(s.prior**2 * v for s, (_, v) in zip(strata, parts, strict=True))))
            total = sum(means)
            relative = sigma / total if total else float("nan")
            words = {
                "misleading": "P(misleading)",
                "exceeding": "P(error beyond a level, no alarm)",
                "brute": f"P(beyond {counts.BRUTE:g} of the limits while GO)",
            }[measure]
            print(f"{site}: {words} {total:.2e}, relative error (1 sigma) {100 * relative:.0f} %")
            largest = sorted(zip(means, strata, strict=True), key=lambda pair: -pair[0])[:5]
            print("   " + ", ".join(f"{s.name} {m:.1e}" for m, s in largest if m > 0.0))
        unseen = sum(found[f"{short}-{k}-{FAR:g}"]["unseen"] for k in range(len(strata)))
        hits = sum(found[f"{short}-{k}-{FAR:g}"]["misleading"][2] for k in range(len(strata)))
        free = approach_of(site).fault_free_risk()
        print(f"   {unseen} of {hits:.0f} drawn misleading approaches by what is not seen; fault-free below {free:.0e}")
        two = next(s.prior for s in strata if s.name == TWO_AT_ONCE)
        print(f"   risk {SITES[site].config.faults.risk:g}, of which two faults at once take {two:.1e}")


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
