"""The bundled landing gives the committed figures; only `make figures` updates them."""

import json
from pathlib import Path

import pytest

from benchmarks.change_indicator import FIGURES, agrees, measured

pytestmark = pytest.mark.usefixtures("unrendered_figures")


def test_the_committed_figures(tmp_path: Path) -> None:
    old = json.loads(FIGURES.read_text())
    new = measured(tmp_path)
    moved = {
        name: (old.get(name), new.get(name))
        for name in {**old, **new}
        if name not in old or name not in new or not agrees(new[name], old[name])
    }
    assert not moved, f"committed and measured differ: {moved}; if that is meant, run `make figures` and say why"
