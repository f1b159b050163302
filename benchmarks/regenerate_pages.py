"""Every figure, table, printed output and picture of README and docs, written from the program.

    python benchmarks/regenerate_pages.py [--check] [--only PART …] [--pictures NAME …] [--work DIR]

outputs     blocks that show what a command prints (benchmarks/pages/printed.py)
figures     figures of sessions in sentences and tables (page_figures.py), and the files in which they are kept; of
            sessions in $GROUNDSTATION_DATA they stay as they are where that is not there
tables      the table "At a glance" of docs/results.md, from the notes (places.py); tables on drawn worlds, from the
            bank's summary (bank_notes.py). Notes record what studies of hours have measured: `make study`
pictures    docs/images (pictures.py): those whose need is there, such as Chromium or a Vulkan driver; others are named

Replays, simulates and flies as the pages do, in DIR, and uses what it finds there of the same program. With --check
nothing is written, pictures are left out, and the exit status is 1 if something differs by more than its last digit.
"""

import argparse
import os
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import bank_notes  # noqa: E402
from pages import glance, kept_figures, page_figures, pictures, printed  # noqa: E402
from pages.workshop import Workshop  # noqa: E402

from tests.docs.inputs import prepare  # noqa: E402

PARTS = ("outputs", "figures", "tables", "pictures")
DATA = Path(os.environ.get("GROUNDSTATION_DATA", ROOT.parent / "shared" / "data"))


def changed(path: Path, text: str, check: bool) -> Iterator[str]:
    """Write a page if its text is another, and yield its lines that are new."""
    old = path.read_text(encoding="utf-8")
    if text != old:
        before = set(old.splitlines())
        lines = [line for line in text.splitlines() if line not in before]
        if not check:
            path.write_text(text, encoding="utf-8")
        yield from (f"{path.relative_to(ROOT)}: {line}" for line in lines or ["lines less"])


def outputs(shop: Workshop, check: bool) -> Iterator[str]:
    """Write the blocks with what commands print; yield those that differ."""
    for page in printed.pages_with_outputs():
        text = page.read_text(encoding="utf-8")
        # from the last on, so that the places of the others stay
        for output in reversed(list(printed.outputs(page))):
            ran = printed.printed(output, shop)
            faults = printed.differs(output, ran)
            yield from faults
            if faults and not check:
                text = text[: output.start] + printed.rewritten(output, ran) + text[output.end :]
        if not check:
            page.write_text(text, encoding="utf-8")


def session_figures(shop: Workshop) -> dict[str, kept_figures.Figures]:
    """Replay the sessions of the pages that are here, and return their figures."""
    found = {}
    for session in kept_figures.SESSIONS:
        source = Path("recordings/landing-1") if session == kept_figures.LANDING else Path(session)
        if session in kept_figures.ELSEWHERE:
            source = DATA / session
            if not source.is_dir():
                print(f"{session}: not in {DATA} ($GROUNDSTATION_DATA); its figures stay as they are kept")
                continue
        if session == kept_figures.SIMULATED:
            shop.run("groundstation simulate --out flights/one --wind 4 --seed 7")
        out = f"out/{source.name}"
        shop.run(f"groundstation replay {source} --out {out}")
        found[session] = kept_figures.figures(kept_figures.summary_of(shop.folder / out))
    return found


def figures(shop: Workshop, check: bool) -> Iterator[str]:
    """Write the files with kept figures, and the pages from them; yield what differs."""
    old, new = kept_figures.kept(), session_figures(shop)
    for session, found in new.items():
        if session not in old:
            yield f"{session}: its figures are not kept yet"
            continue
        for name in kept_figures.moved(old[session], found):
            yield f"{session}: {name} kept {old[session].get(name)}, now {found.get(name)}"
    if not check:
        kept_figures.keep({**old, **new})
    values = kept_figures.quotable(kept_figures.kept())
    for page in page_figures.PAGES:
        path = ROOT / page
        yield from changed(path, page_figures.rewritten(page, path.read_text(encoding="utf-8"), values), check)


def tables(check: bool) -> Iterator[str]:
    """Write the tables that are made from notes and from the bank's summary; yield what differs."""
    summary = bank_notes.read(bank_notes.SUMMARY)
    notes = bank_notes.notes_page(summary, bank_notes.read(bank_notes.BASELINE))
    yield from changed(bank_notes.NOTES, notes, check)
    page = bank_notes.with_part(bank_notes.RESULTS.read_text(encoding="utf-8"), bank_notes.results_part(summary))
    yield from changed(glance.RESULTS, glance.rewritten(page, glance.linked_sections()), check)


def main() -> int:
    """Write the pages, or compare them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="write nothing; exit 1 if something differs")
    parser.add_argument("--only", choices=PARTS, nargs="+", default=PARTS, help="these parts; default: all")
    names = [picture.name for picture in pictures.PICTURES]
    parser.add_argument("--pictures", nargs="+", metavar="NAME", choices=names, help="these files of docs/images alone")
    default = ROOT / "out" / "pages"
    parser.add_argument("--work", type=Path, metavar="DIR", default=default, help="where commands run (out/pages)")
    options = parser.parse_args()
    shop = Workshop(options.work.resolve(), prepare)
    found: list[str] = []
    if "outputs" in options.only:
        found += outputs(shop, options.check)
    if "figures" in options.only:
        found += figures(shop, options.check)
    if "tables" in options.only:
        found += tables(options.check)
    for line in found:
        print(line)
    print(f"{len(found)} lines differ" if options.check else f"{len(found)} lines differed")
    if "pictures" in options.only and not options.check:
        for line in pictures.remade(shop, ROOT / "docs" / "images", options.pictures):
            print(line)
    return 1 if options.check and found else 0


if __name__ == "__main__":
    sys.exit(main())
