"""The documentation's blocks that take longer than 5 s: `make docs-check` runs them, `make test` runs all others.

Measured with three tests at a time on two cores, with the inputs that are made for a block (tests/docs/inputs.py). A
block that uses what a long one leaves is with it.
"""

from pathlib import Path

from pages.printed import Output, outputs, pages_with_outputs

from tests.docs.pages import PAGES, Block, blocks

BLOCKS = {page: tuple(blocks(page)) for page in PAGES}
# the page and how the block's first line begins
LONG = (
    ("airstrip.md", "groundstation plan docs/site-example.toml"),
    ("airstrip.md", "groundstation replay flights/2025-06-21T10-30-00Z/flight.mcap"),
    ("calibration.md", "groundstation calibrate flight session --out rig.toml"),
    ("calibration.md", "groundstation simulate --out night --night 6"),
    ("first-flight.md", "groundstation live --simulate"),
    ("first-flight.md", "groundstation replay out/live/flight.mcap"),
    ("live.md", "groundstation live --simulate --out out/live --for 60 --web"),
    ("ptu.md", "groundstation ptu simulate --link unit &"),
    ("replay.md", "groundstation replay recordings/landing-1 --out out/recorded"),
)


def is_long(block: Block) -> bool:
    """Whether a block is on the list of those that `make docs-check` runs."""
    return any(block.page.name == name and block.commands[0].startswith(line) for name, line in LONG)


def run_by_test(page: Path) -> tuple[Block, ...]:
    """The blocks of a page that `make test` runs."""
    return tuple(block for block in BLOCKS[page] if not block.parsed_only and not is_long(block))


def run_by_docs_check(page: Path) -> tuple[Block, ...]:
    """The blocks of a page that `make docs-check` runs."""
    return tuple(block for block in BLOCKS[page] if not block.parsed_only and is_long(block))


# commands whose output a page shows that end within 5 s as they are shown
QUICK = ("groundstation import recordings/landing-1/left.mp4 ",)


def printed_by_test() -> list[Output]:
    """The blocks with what a command prints that `make test` compares."""
    return [output for page in pages_with_outputs() for output in outputs(page) if output.command.startswith(QUICK)]


def printed_by_docs_check() -> list[Output]:
    """The blocks with what a command prints that `make docs-check` compares."""
    quick = printed_by_test()
    return [output for page in pages_with_outputs() for output in outputs(page) if output not in quick]
