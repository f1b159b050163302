"""The tables of the results on drawn worlds, from the bank's summary that is committed.

    python benchmarks/bank_notes.py [--from out/validate [DIR ...] --words "commit 0123456789ab, two cores"]

Without --from, the pages are written from `benchmarks/bank/validate.json`; with it, that file and `validate.parquet`,
the rows, are replaced first. Banks of the same program over worlds that follow each other are pooled (of a bank of 200
worlds in two parts, `first = 0`, `sessions = 120` and `first = 120`, `sessions = 80`). docs/notes/bank.md is written
whole, in docs/results.md what stands between the two marks.

The baseline (`groundstation bank --csrt-python FILE`) takes as long as all the rest and does not depend on the program:
what it gave on the worlds of `benchmarks/bank/baseline.json` (the distributions of its columns in bank.json) stands
next to what the program gives on the same worlds.
"""

import argparse
import json
from dataclasses import asdict
from itertools import pairwise
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

from groundstation.bank.bank_page import interval_text, share_text
from groundstation.bank.bank_settings import BankSettings
from groundstation.bank.bank_summary import bank_summary
from groundstation.bank.pooled_figures import distributions
from groundstation.bank.result_table import Row, table_hash, write_table
from groundstation.simulation.world.world_sets import WorldSet, seed_of

ROOT = Path(__file__).resolve().parents[1]
SUMMARY = ROOT / "benchmarks" / "bank" / "validate.json"
BASELINE = ROOT / "benchmarks" / "bank" / "baseline.json"
NOTES = ROOT / "docs" / "notes" / "bank.md"
RESULTS = ROOT / "docs" / "results.md"
BEGIN, END = "<!-- bank: written by benchmarks/bank_notes.py -->", "<!-- bank: end -->"
# of the pooled figures, those that are no shares
_PLAIN = ("ANEES", "NIS")
_MOST_CLASSES = 25
# settings of sessions that are compared or pooled
_SAME = ("world_set", "duration_s", "frame_hz")
_FEWEST_SESSIONS = 5


def pooled_row(figure: dict[str, Any]) -> str:
    percent = not figure["title"].startswith(_PLAIN)
    value = share_text(figure["value"]) if percent else f"{figure['value']:.3g}"
    interval = interval_text(figure["low"], figure["high"], percent)
    # the two are about different things, and neither is quoted without the other
    title = f"{figure['title']}; NIS is in the next row" if figure["title"].startswith("ANEES") else figure["title"]
    return f"| {title} | {value} | {interval} | {figure['sessions']} |"


def pooled_table(summary: dict[str, Any]) -> str:
    rows = [pooled_row(figure) for figure in summary["pooled"] if figure["value"] is not None]
    return "\n".join(["| drawn worlds, pooled | measured | 95 % | sessions |", "|---|---|---|---|", *rows])


def distribution_table(summary: dict[str, Any]) -> str:
    head = ["| over sessions | 5 % | 25 % | 50 % | 75 % | 95 % | sessions |", "|---|---|---|---|---|---|---|"]
    rows = [
        f"| {found['title']} | {' | '.join(f'{value:.3g}' for value in found['quantiles'])} | {found['count']} |"
        for found in summary["distributions"]
    ]
    return "\n".join(head + rows)


def pooled_banks(banks: list[Path]) -> tuple[dict[str, Any], list[Row]]:
    """Return the summary of one bank, or of several over worlds that follow each other, and their rows by seed."""
    parts = [read(bank / "bank.json") for bank in banks]
    parts, banks = zip(*sorted(zip(parts, banks, strict=True), key=lambda p: p[0]["settings"]["first"]), strict=True)
    rows: list[Row] = [row for bank in banks for row in pq.read_table(bank / "rows.parquet").to_pylist()]
    if len(parts) == 1:
        return parts[0], rows
    if len({part.get("program") for part in parts}) > 1:
        raise SystemExit(f"banks: got programs {[part.get('program') for part in parts]}, wanted the same")
    settings = [part["settings"] for part in parts]
    for before, after in pairwise(settings):
        same = all(before[name] == after[name] for name in _SAME)
        if not same or after["first"] != before["first"] + before["sessions"]:
            raise SystemExit(f"banks: got {before}, then {after}; wanted worlds that follow each other")
    whole = settings[0] | {
        "sessions": sum(s["sessions"] for s in settings),
        "world_set": WorldSet(settings[0]["world_set"]),
    }
    summary = bank_summary(BankSettings(**whole), rows, (), table_hash(rows), program=parts[0].get("program"))
    return summary | {"failed": [failure for part in parts for failure in part["failed"]]}, rows


def same_worlds(rows: list[Row], settings: dict[str, Any], baseline: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the program's distributions on the worlds of the baseline; ``rows`` and ``settings`` are a bank's."""
    worlds = baseline["settings"]
    if any(settings[name] != worlds[name] for name in _SAME):
        raise SystemExit(f"bank: got {settings}, wanted sessions as those of the baseline, {worlds}")
    seeds = {seed_of(WorldSet(worlds["world_set"]), worlds["first"] + k) for k in range(worlds["sessions"])}
    same = [row for row in rows if int(row["seed"]) in seeds]
    if len(same) != len(seeds):
        raise SystemExit(f"rows: got {len(same)} of the {len(seeds)} worlds of the baseline, wanted all")
    return [asdict(found) for found in distributions(same)]


def baseline_table(baseline: dict[str, Any], ours: list[dict[str, Any]]) -> str:
    """Return figures of the baseline, and below each the program's on the same worlds."""
    known = {found["column"]: found for found in ours}
    lines = ["| over sessions | of | 5 % | 25 % | 50 % | 75 % | 95 % | sessions |", "|---|---|---|---|---|---|---|---|"]
    for theirs in baseline["distributions"]:
        own = known[theirs["column"].removeprefix("baseline_")]
        for name, found in (("baseline", theirs), ("program", own)):
            quantiles = " | ".join(f"{value:.3g}" for value in found["quantiles"])
            lines.append(f"| {own['title']} | {name} | {quantiles} | {found['count']} |")
    return "\n".join(lines)


def factor_table(summary: dict[str, Any]) -> str:
    """Return the classes of enough sessions that cost most hits."""
    head = [
        "| factor | class | sessions | visible frames | hit | 95 % | wrong | excluded | harm, points |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    known = [share for share in summary["factors"] if share["sessions"] >= _FEWEST_SESSIONS]
    rows = [
        f"| {share['factor']} | {share['kind']} | {share['sessions']} | {share['frames']} | "
        f"{share_text(share['hit'])} | {interval_text(share['low'], share['high'])} | {share_text(share['wrong'])} | "
        f"{share_text(share['excluded'])} | {100 * share['harm']:+.1f} |"
        for share in known[:_MOST_CLASSES]
    ]
    return "\n".join(head + rows)


def worlds_text(summary: dict[str, Any]) -> str:
    """Return which worlds were run and by what."""
    settings = summary["settings"]
    first = settings["first"]
    last = first + settings["sessions"] - 1
    return (
        f"{summary['sessions']} worlds of the set *{settings['world_set']}* (numbers {first} to {last}), "
        f"{settings['duration_s']:g} s at {settings['frame_hz']:g} Hz; {summary['words']}."
    )


def notes_page(summary: dict[str, Any], baseline: dict[str, Any]) -> str:
    """Return docs/notes/bank.md."""
    those = baseline["settings"]
    last = those["first"] + those["sessions"] - 1
    worst = ", ".join(str(seed) for seed in summary["worst"])
    sessions, rows = summary["settings"]["sessions"], summary["sha256"][:16]
    failed = len(summary["failed"])
    return f"""# Drawn worlds

How the program does on worlds that it was not made for: [the bank](../bank.md) draws, renders, replays and scores them;
definitions are on its page. This page is written by `benchmarks/bank_notes.py` from the files in `benchmarks/bank`.

## Validate set

{worlds_text(summary)} {failed} sessions failed. Command:
`groundstation bank benchmarks/bank/validate.toml --out DIR` with `sessions = {sessions}`. SHA-256 of rows: `{rows}`.

{pooled_table(summary)}

{distribution_table(summary)}

## The baseline

[What a user would set up in an afternoon](../bank.md#the-baseline): {baseline["words"]},
midpoint triangulation, a Kalman filter; worlds {those["first"]} to {last}, {those["duration_s"]:g} s. The program found
the aircraft by itself. The baseline's share of epochs is of all of the truth, as it was counted then;
the program's is from its first estimate on.

{baseline_table(baseline, summary["baseline_worlds"])}

## Conditions by harm

Classes of at least {_FEWEST_SESSIONS} sessions; harm is by how many points the share of hits over all frames
would rise if the class had that of all others.

{factor_table(summary)}

Worlds with the lowest share of hits: {worst};
`groundstation simulate --world SEED --duration {summary["settings"]["duration_s"]:g} --out DIR` renders one.
"""


def results_part(summary: dict[str, Any]) -> str:
    """Return the first table of docs/results.md with its marks."""
    words = f"{worlds_text(summary)} [Distributions, conditions by harm](notes/bank.md)"
    return f"{BEGIN}\n{words}\n\n{pooled_table(summary)}\n{END}"


def with_part(page: str, part: str) -> str:
    """Return a page with what stands between the marks replaced."""
    before, _, rest = page.partition(BEGIN)
    return before + part + rest.partition(END)[2]


def read(path: Path) -> dict[str, Any]:
    document: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return document


def main() -> None:
    """Write both pages."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--from", dest="banks", type=Path, nargs="+", metavar="DIR", help="outputs of banks")
    parser.add_argument("--words", default="", help="what ran it: commit, machine")
    options = parser.parse_args()
    if options.banks is not None:
        found, rows = pooled_banks(options.banks)
        found |= {"words": options.words, "baseline_worlds": same_worlds(rows, found["settings"], read(BASELINE))}
        SUMMARY.write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        write_table(SUMMARY.with_suffix(".parquet"), rows)
    summary = read(SUMMARY)
    NOTES.write_text(notes_page(summary, read(BASELINE)), encoding="utf-8")
    RESULTS.write_text(with_part(RESULTS.read_text(encoding="utf-8"), results_part(summary)), encoding="utf-8")
    print(f"wrote {NOTES.relative_to(ROOT)} and {RESULTS.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
