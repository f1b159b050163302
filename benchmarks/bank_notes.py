"""The tables of the results on drawn worlds, from the bank's summary that is committed.

    python benchmarks/bank_notes.py [--from out/validate/bank.json --words "commit 0123456789ab, two cores"]

Without --from, the pages are written from `benchmarks/bank/validate.json`; with it, that file is replaced first.
docs/notes/bank.md is written whole, in docs/results.md what stands between the two marks.
"""

import argparse
import json
from pathlib import Path
from typing import Any

from groundstation.bank.bank_page import interval_text, share_text

ROOT = Path(__file__).resolve().parents[1]
SUMMARY = ROOT / "benchmarks" / "bank" / "validate.json"
NOTES = ROOT / "docs" / "notes" / "bank.md"
RESULTS = ROOT / "docs" / "results.md"
BEGIN, END = "<!-- bank: written by benchmarks/bank_notes.py -->", "<!-- bank: end -->"
# of the pooled figures, those that are no shares
_PLAIN = ("ANEES", "NIS")
_MOST_CLASSES = 25
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


def notes_page(summary: dict[str, Any]) -> str:
    """Return docs/notes/bank.md."""
    worst = ", ".join(str(seed) for seed in summary["worst"])
    failed = len(summary["failed"])
    return f"""# Drawn worlds

How the program does on worlds that it was not made for: [the bank](../bank.md) draws, renders, replays and scores them;
definitions are on its page. This page is written by `benchmarks/bank_notes.py` from `benchmarks/bank/validate.json`.

## Validate set

{worlds_text(summary)} {failed} sessions failed. Command: `groundstation bank benchmarks/bank/validate.toml --out DIR
--csrt-python FILE`. SHA-256 of the rows: `{summary["sha256"][:16]}`.

{pooled_table(summary)}

{distribution_table(summary)}

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


def main() -> None:
    """Write both pages."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--from", dest="source", type=Path, metavar="FILE")
    parser.add_argument("--words", default="", help="what ran it: commit, machine")
    options = parser.parse_args()
    if options.source is not None:
        found = json.loads(options.source.read_text(encoding="utf-8")) | {"words": options.words}
        SUMMARY.write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    summary = json.loads(SUMMARY.read_text(encoding="utf-8"))
    NOTES.write_text(notes_page(summary), encoding="utf-8")
    RESULTS.write_text(with_part(RESULTS.read_text(encoding="utf-8"), results_part(summary)), encoding="utf-8")
    print(f"wrote {NOTES.relative_to(ROOT)} and {RESULTS.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
