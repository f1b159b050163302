"""`make docs-check`: the commands of the documentation that take longer than 5 s are run, and their output compared.

This file's name is not that of a test file, so `make test` does not collect it; tests/docs/test_commands.py checks that
each block is run by one of the two.
"""

from pathlib import Path

import pytest
from pages.printed import Output, differs, printed
from pages.workshop import Workshop

from tests.docs.inputs import prepare
from tests.docs.long_blocks import printed_by_docs_check, run_by_docs_check
from tests.docs.pages import PAGES, ROOT
from tests.docs.run_blocks import run_blocks

pytestmark = pytest.mark.usefixtures("unrendered_figures", "unhurried_shutdown")


@pytest.mark.parametrize("page", [p for p in PAGES if run_by_docs_check(p)], ids=lambda p: str(p.relative_to(ROOT)))
def test_long_commands_run(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, answered: list[str]) -> None:
    run_blocks(run_by_docs_check(page), tmp_path, monkeypatch, answered)


@pytest.fixture(scope="module")
def shop(tmp_path_factory: pytest.TempPathFactory) -> Workshop:
    return Workshop(tmp_path_factory.mktemp("pages"), prepare)


@pytest.mark.parametrize("output", printed_by_docs_check(), ids=lambda output: f"{output.page.name}: {output.command}")
def test_a_long_command_prints_what_the_page_shows(output: Output, shop: Workshop) -> None:
    """As the page shows it, without an option that shortens it."""
    assert differs(output, printed(output, shop)) == []
