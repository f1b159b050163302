"""docs/simulation.md: its example runs."""

from pathlib import Path

import numpy as np

from groundstation.simulation.simulate import SimulatedFlight

PAGE = Path(__file__).resolve().parents[2] / "docs" / "simulation.md"


def names_of_example(number: int) -> dict[str, object]:
    code = PAGE.read_text(encoding="utf-8").split("```python\n")[number].split("```")[0]
    names: dict[str, object] = {}
    exec(compile(code, str(PAGE), "exec"), names)
    return names


def test_the_example_runs() -> None:
    off_m = names_of_example(1)["off_m"]
    assert isinstance(off_m, np.ndarray)
    assert np.abs(off_m).max() < 5.0


def test_the_example_of_drawn_flights_runs() -> None:
    flight = names_of_example(2)["flight"]
    assert isinstance(flight, SimulatedFlight)
    assert flight.truth.t_s[-1] > 19.0
