"""`make docs-check`: the commands of the documentation that take longer than 5 s are run.

This file's name is not that of a test file, so `make test` does not collect it; tests/docs/test_commands.py checks that
each block is run by one of the two.
"""

from pathlib import Path

import pytest

from tests.docs.long_blocks import run_by_docs_check
from tests.docs.pages import PAGES, ROOT
from tests.docs.run_blocks import run_blocks

pytestmark = pytest.mark.usefixtures("unrendered_figures", "unhurried_shutdown")


@pytest.mark.parametrize("page", [p for p in PAGES if run_by_docs_check(p)], ids=lambda p: str(p.relative_to(ROOT)))
def test_long_commands_run(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, answered: list[str]) -> None:
    run_blocks(run_by_docs_check(page), tmp_path, monkeypatch, answered)
