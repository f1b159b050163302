"""What all tests of stars share: the solver's patterns, made once for all runs."""

from collections.abc import Iterator

import pytest

from tests.calibration.stars.kept_patterns import keeping_solver
from tests.conftest import ROOT


@pytest.fixture(scope="module", autouse=True)
def _kept_patterns() -> Iterator[None]:
    solver = keeping_solver(ROOT / "build" / "stars")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("calibration.stars.star_solver.load_tetra3rs", lambda: solver)
        yield
