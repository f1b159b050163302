"""Rendered worlds that are kept: a later run of the bank replays them, and renders only what is not there."""

import hashlib
from functools import cache
from pathlib import Path

from groundstation import simulation
from groundstation.errors import InputError
from groundstation.files.output_names import below
from groundstation.simulation.world.render_world import render_world
from groundstation.simulation.world.world import World
from groundstation.simulation.world.world_file import world_text

_DIGEST_CHARACTERS = 16


def rendered_world(world: World, folder: Path) -> Path:
    """Return a world's session folder below ``folder``; renders it if it is not there.

    A folder is used again for the same world, rendered by the same files of the package `simulation`; its name says
    which. Raises `InputError` where it cannot be written.
    """
    digest = hashlib.sha256(f"{_renderer_digest()}\n{world_text(world)}".encode()).hexdigest()
    session = below(folder, f"world-{world.seed}-{digest[:_DIGEST_CHARACTERS]}")
    if session.is_dir():
        return session
    try:
        render_world(world, session)
    except InputError:
        # another process may have rendered the same world meanwhile; a folder gets its name when it is complete
        if not session.is_dir():
            raise
    return session


@cache
def _renderer_digest() -> str:
    """Return the SHA-256 of the package that draws, flies and renders; what it imports changes no picture by itself."""
    root, digest = Path(simulation.__path__[0]), hashlib.sha256()
    for path in sorted(root.rglob("*.py")):
        digest.update(path.relative_to(root).as_posix().encode())
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()
