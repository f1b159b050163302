"""docs/simulation.md: its example runs."""

from pathlib import Path

import numpy as np

PAGE = Path(__file__).resolve().parents[2] / "docs" / "simulation.md"


def test_the_example_runs() -> None:
    code = PAGE.read_text(encoding="utf-8").split("```python\n")[1].split("```")[0]
    names: dict[str, object] = {}
    exec(compile(code, str(PAGE), "exec"), names)
    off_m = names["off_m"]
    assert isinstance(off_m, np.ndarray)
    assert np.abs(off_m).max() < 5.0
