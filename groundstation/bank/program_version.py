"""The version of the program as a digest of its files: results of another program are not taken for its own."""

import hashlib
import importlib.util
import inspect
import json
from collections.abc import Callable, Iterator
from functools import cache, partial
from importlib import metadata
from pathlib import Path
from typing import Any

from groundstation import __version__

PACKAGES = ("groundstation", "calibration", "ptu_drivers")
# what decodes pictures, fits and compiles; OpenCV by any of its packages
_OPENCV = ("opencv-python-headless", "opencv-python", "opencv-contrib-python-headless", "opencv-contrib-python")
_LIBRARIES = ("numpy", "scipy", "numba", "onnxruntime", *_OPENCV)


@cache
def program_digest() -> str:
    """Return version and SHA-256 of all files of the program's packages, compiled ones left out."""
    digest = hashlib.sha256()
    for name, path in _files():
        digest.update(name.encode())
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    return f"{__version__}+{digest.hexdigest()}"


def function_digest(function: Callable[..., Any]) -> str:
    """Return name and SHA-256 of the file of a function; what `functools.partial` binds is not in it."""
    while isinstance(function, partial):
        function = function.func
    source = inspect.getsourcefile(function)
    content = Path(source).read_bytes() if source is not None else b""
    return f"{function.__qualname__}+{hashlib.sha256(content).hexdigest()}"


def identity_of(function: Callable[..., Any], settings: str) -> str:
    """Return what decides that a result can be used again: program, libraries, function and settings, as a SHA-256."""
    parts = [program_digest(), *library_versions(), function_digest(function), settings]
    return hashlib.sha256(json.dumps(parts).encode()).hexdigest()


def library_versions() -> tuple[str, ...]:
    """Return the versions of the libraries that results depend on, where they are installed."""
    found = []
    for name in _LIBRARIES:
        try:
            found.append(f"{name} {metadata.version(name)}")
        except metadata.PackageNotFoundError:
            continue
    return tuple(found)


def _files() -> Iterator[tuple[str, Path]]:
    for package in PACKAGES:
        spec = importlib.util.find_spec(package)
        if spec is None or spec.origin is None:
            continue
        root = Path(spec.origin).parent
        for path in sorted(root.rglob("*")):
            if path.is_file() and "__pycache__" not in path.parts:
                yield f"{package}/{path.relative_to(root).as_posix()}", path
