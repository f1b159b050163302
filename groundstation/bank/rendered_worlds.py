"""Rendered worlds that are kept: a later run of the bank replays them, and renders only what is not there."""

import hashlib
import importlib
import tempfile
from functools import cache
from pathlib import Path

import cv2
import numba
import numpy as np

from groundstation.errors import InputError, os_words
from groundstation.files.output_names import below
from groundstation.simulation.world.render_world import render_world
from groundstation.simulation.world.world import World
from groundstation.simulation.world.world_file import world_text

_DIGEST_CHARACTERS = 16
# what draws, flies and renders, and by which geometry, pictures and files
_RENDERER = ("simulation", "geometry", "rig", "picture", "recording", "files")


def rendered_world(world: World, folder: Path) -> Path:
    """Return a world's session folder below ``folder``; renders it if it is not there.

    A folder is used again for the same world, rendered by the same files of the program and the same versions of
    numpy, numba and OpenCV; its name says which. Raises `InputError` where it cannot be written.
    """
    digest = hashlib.sha256(f"{_renderer_digest()}\n{world_text(world)}".encode()).hexdigest()
    session = below(folder, f"world-{world.seed}-{digest[:_DIGEST_CHARACTERS]}")
    if _is_whole(session):
        return session
    try:
        folder.mkdir(parents=True, exist_ok=True)
        # a name of its own, as processes of several machines may share the folder
        with tempfile.TemporaryDirectory(prefix=".rendering-", dir=folder) as draft:
            rendered = Path(draft) / "session"
            render_world(world, rendered)
            if not _is_whole(session):
                rendered.rename(session)
    except OSError as fault:
        if not _is_whole(session):
            raise InputError(str(session), got=os_words(fault), wanted="a folder that can be written") from fault
    return session


def _is_whole(session: Path) -> bool:
    return (session / "session.toml").is_file()


@cache
def _renderer_digest() -> str:
    """Return the SHA-256 of all that decides on a pixel or a table of a rendered world, but the world itself."""
    digest = hashlib.sha256()
    digest.update(f"{np.__version__} {numba.__version__} {cv2.__version__}".encode())
    for name in _RENDERER:
        module = importlib.import_module(f"groundstation.{name}")
        root = Path(str(module.__file__))
        for path in sorted(root.parent.rglob("*.py")) if root.name == "__init__.py" else [root]:
            digest.update(f"{name}/{path.relative_to(root.parent).as_posix()}".encode())
            digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()
