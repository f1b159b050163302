"""What each rule of search, detection and track management brings: drawn worlds replayed without it.

    python benchmarks/rule_ablation.py [--first N] [--worlds N] [--every K] [--keep DIR] [--rule NAME ...] [--workers N]

Every K-th of N worlds of the validate set, 10 s at 10 Hz, is replayed as it is, and once more without each rule of
`benchmarks/rules`. DIR keeps the rendered worlds, also those of `groundstation bank --worlds DIR`. Printed is a row for
each rule: by how much hits and wrong points change without it, in points, each with the 95 % interval of a bootstrap
over worlds; epochs that mislead; the pooled ANEES; seconds from the first view to tracking, mean; processor time.
"""

import argparse
import contextlib
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bank_mutation import difference
from parallel_study import STUDIES, StudyRun, add_study_arguments
from rules.all_rules import RULES

from groundstation.bank.pooled_figures import HIT, WRONG
from groundstation.bank.rendered_worlds import rendered_world
from groundstation.bank.result_table import Row
from groundstation.bank.score_world import WorldJob, score_world
from groundstation.simulation.world.draw_world import draw_world
from groundstation.simulation.world.world_sets import WorldSet, seed_of

DURATION_S, FRAME_HZ = 10.0, 10.0
AS_IT_IS = "as it is"
HEAD = "| without | hits, points | wrong, points | misleading | ANEES | to tracking, s | processor time |"


def scored_without(item: dict[str, Any]) -> Row:
    """Return a world's row without the rule of ``item``, and the processor time, s."""
    rule = None if item["rule"] == AS_IT_IS else {each.name: each for each in RULES}[item["rule"]]
    job = WorldJob(seed=item["seed"], duration_s=DURATION_S, frame_hz=FRAME_HZ, worlds=item["keep"])
    # what is rendered first is not the rule's time
    rendered_world(draw_world(job.seed, duration_s=job.duration_s, frame_hz=job.frame_hz), Path(item["keep"]))
    began_s = time.process_time()
    with contextlib.nullcontext() if rule is None else rule.left_out():
        row: Row = score_world(job)["row"]
    return {**row, "cpu_s": time.process_time() - began_s}


def line(name: str, before: Sequence[Row], after: Sequence[Row]) -> str:
    """Return a rule's row of the table."""
    if after is before:
        shares = [f"{100.0 * _sum(before, r.above) / _sum(before, r.below):.2f} %" for r in (HIT, WRONG)]
    else:
        changes = [[100.0 * share for share in difference(before, after, ratio)] for ratio in (HIT, WRONG)]
        shares = ["{:+.2f} ({:+.2f} … {:+.2f})".format(*points) for points in changes]
    anees = _sum(after, "nees_sum") / max(3.0 * _sum(after, "nees_count"), 1.0)
    waited = [float(row["time_to_track_s"]) for row in after if row["time_to_track_s"] is not None]
    mean_s = sum(waited) / max(len(waited), 1)
    cost = _sum(after, "cpu_s") / _sum(before, "cpu_s")
    misleading = f"{_sum(after, 'misleading_epochs'):.0f} of {_sum(after, 'tracking_epochs'):.0f}"
    return f"| {name} | {' | '.join(shares)} | {misleading} | {anees:.2f} | {mean_s:.2f} ({len(waited)}) | {cost:.2f} |"


def _sum(rows: Sequence[Row], column: str) -> float:
    return sum(float(row[column] or 0.0) for row in rows)


def main() -> int:
    """Replay all worlds with and without the rules, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--worlds", type=int, default=53)
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--keep", type=Path, default=STUDIES / "worlds")
    parser.add_argument("--rule", action="append", choices=[rule.name for rule in RULES], metavar="NAME")
    add_study_arguments(parser, "rule-ablation")
    options = parser.parse_args()
    seeds = [seed_of(WorldSet.VALIDATE, k) for k in range(options.first, options.first + options.worlds, options.every)]
    keep = str(options.keep.resolve())
    names = [AS_IT_IS, *(options.rule or [rule.name for rule in RULES])]
    items: dict[str, dict[str, Any]] = {
        f"{number}-{seed}": {"seed": seed, "rule": name, "keep": keep}
        for number, name in enumerate([AS_IT_IS, *(rule.name for rule in RULES)])
        if name in names
        for seed in seeds
    }
    rows = StudyRun.chosen("rule ablation", options).values(scored_without, items)
    by_rule: dict[str, list[Row]] = {name: [] for name in names}
    for key, item in items.items():
        by_rule[item["rule"]].append(rows[key])
    print(HEAD)
    print("|---" * (HEAD.count("|") - 1) + "|")
    for name in names:
        print(line(name, by_rule[AS_IT_IS], by_rule[name]))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
