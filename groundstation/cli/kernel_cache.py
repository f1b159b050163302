"""Where numba keeps compiled kernels if neither the program's folders nor the user's cache can be written.

Numba refuses to compile then: of a program that root has installed, run by an account without a home.
"""

import os
import stat
import tempfile
from collections.abc import Mapping
from pathlib import Path

import groundstation

_PRIVATE = 0o700


def kernel_cache(environment: Mapping[str, str], package: Path = Path(groundstation.__file__).parent) -> dict[str, str]:
    """Return the variable that names a folder for kernels; nothing where numba finds one of its own."""
    if "NUMBA_CACHE_DIR" in environment:
        return {}
    home = environment.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")  # noqa: PTH111 - it may have no home
    if _can_be_written(package / "__pycache__") or _can_be_written(Path(home) / "numba"):
        return {}
    return {"NUMBA_CACHE_DIR": str(_temporary())}


def _can_be_written(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK | os.X_OK)


def _temporary() -> Path:
    """Return a folder of this user alone, which later runs find again; what is in it is executed."""
    name = f"groundstation-kernels-{os.getuid()}"
    folder = Path(tempfile.gettempdir()) / name
    try:
        folder.mkdir(mode=_PRIVATE)
    except FileExistsError:
        found = folder.lstat()
        own = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid()
        if not own or stat.S_IMODE(found.st_mode) != _PRIVATE:
            return Path(tempfile.mkdtemp(prefix="groundstation-kernels-"))
    return folder
