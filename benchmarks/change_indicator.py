"""The committed figures of the bundled landing: the effect of a code change on them is visible in review.

    python benchmarks/change_indicator.py             print them with the committed ones
    python benchmarks/change_indicator.py --update    and commit to the new ones

`tests/replay/test_rendered_sessions.py` compares within the tolerances of
`benchmarks/pages/kept_figures.py`; `make pages` writes the same file, and the pages from it.
"""

import argparse
import json
import sys
import tempfile
from pathlib import Path

from pages.kept_figures import LANDING_FILE as FIGURES
from pages.kept_figures import agrees, figures, summary_of

from groundstation.replay.replay import ReplayRequest, replay

ROOT = Path(__file__).resolve().parent.parent


def measured(out: Path) -> dict[str, float]:
    """Replay the bundled landing into ``out`` and return its figures."""
    replay(ReplayRequest(session=ROOT / "recordings" / "landing-1", out=out, rerun=False))
    return figures(summary_of(out))


def main() -> int:
    """Print the comparison; exit 1 if a figure has moved and is not being updated."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--update", action="store_true", help="write the new figures")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        new = measured(Path(folder))
    old = json.loads(FIGURES.read_text()) if FIGURES.is_file() else {}
    moved = 0
    for name in {**old, **new}:
        mark = ""
        if name not in old or name not in new or not agrees(new[name], old[name]):
            mark, moved = "  ← moved", moved + 1
        print(f"{name:42s} {old.get(name, '–')!s:>12} {new.get(name, '–')!s:>12}{mark}")
    if options.update:
        FIGURES.write_text(json.dumps(new, indent=1) + "\n")
        return 0
    return 1 if moved else 0


if __name__ == "__main__":
    sys.exit(main())
