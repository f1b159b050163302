"""Independent programs used as references: skipped where they are absent, unless they are required.

`.ci/run` sets GROUNDSTATION_REQUIRED_PEERS to the names of those that it could install: a test that would skip without
one of them fails.
"""

import importlib
import os
from types import ModuleType
from typing import NoReturn

import pytest

VARIABLE = "GROUNDSTATION_REQUIRED_PEERS"


def absent(peer: str, how_to_get: str) -> NoReturn:
    """Skip the test or module that needs it, or fail it."""
    reported = f"{peer} is not here: {how_to_get}"
    if peer in os.environ.get(VARIABLE, "").split():
        pytest.fail(f"{reported} ({VARIABLE} names it)")
    pytest.skip(reported, allow_module_level=True)


def peer_module(peer: str, module: str) -> ModuleType:
    """Return a peer that is a Python module of the development extra."""
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError:
        absent(peer, "pip install 'groundstation[dev]'")
