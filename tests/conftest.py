"""Fixtures that all tests share: where the data is, and seeded randomness."""

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings

ROOT = Path(__file__).resolve().parent.parent

# `make test` draws the same examples every time; `make fuzz` draws new ones and remembers what failed
settings.register_profile("same", derandomize=True, deadline=None)
settings.register_profile("new", max_examples=2000, deadline=None, print_blob=True)
settings.load_profile("same")


def _shared_data() -> Path:
    return Path(os.environ.get("GROUNDSTATION_DATA", ROOT.parent / "shared" / "data"))


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of independent recordings, which are not part of the project."""
    folder = _shared_data()
    if not folder.is_dir():
        pytest.skip(f"independent recordings not found at {folder}; set GROUNDSTATION_DATA")
    return folder


@pytest.fixture(scope="session")
def landing_1() -> Path:
    """The bundled stereo landing."""
    return ROOT / "recordings" / "landing-1"


@pytest.fixture
def rng(request: pytest.FixtureRequest) -> np.random.Generator:
    """A generator seeded by the test's own name: the same draw in each run, another in each test."""
    return np.random.default_rng(list(request.node.name.encode()))
