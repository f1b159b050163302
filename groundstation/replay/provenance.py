"""Where a run's results come from: date, program, command, inputs with their hashes, and machine."""

import hashlib
import os
import platform
import shlex
import subprocess
import time
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from functools import lru_cache
from pathlib import Path
from typing import Any

from groundstation import __version__
from groundstation.replay.replay_request import ReplayRequest
from groundstation.replay.result_files import REPLAY_FILES
from groundstation.session import Session

_ROOT = Path(__file__).resolve().parent.parent.parent
_GIT_S = 5.0
# a larger file is hashed in so many blocks, evenly spread over it, the first and the last among them
_WHOLE_BYTES, _BLOCKS, _BLOCK_BYTES = 256 << 20, 64, 1 << 20
_READ_BYTES = 1 << 20
# the times of files are those of a clock that ticks every few ms; some file systems count whole seconds, FAT two
_SETTLED_NS = 3_000_000_000


def provenance(request: ReplayRequest, session: Session, configuration: str) -> dict[str, Any]:
    """Return the provenance of a replay for `summary.json`; ``configuration`` is the tuning as text, with all defaults.

    ``session`` and its rig are hashed as they lie on the disk; where a file cannot be read there is no hash.
    """
    path = Path(os.path.realpath(request.session))
    own_rig = path / "rig.toml" if session.recorded is None else Path(os.path.realpath(session.recorded.path))
    rig = own_rig if request.rig is None else Path(os.path.realpath(request.rig))
    return program_provenance(request.command) | {
        "session": {"path": str(path), "sha256": hash_of(_inputs(path, session))},
        "rig": file_provenance(rig),
        "configuration": {
            "path": None if request.config is None else str(Path(os.path.realpath(request.config))),
            "sha256": hashlib.sha256(configuration.encode()).hexdigest(),
        },
        **({} if request.panorama is None else {"panorama": file_provenance(request.panorama)}),
    }


def program_provenance(command: Sequence[str]) -> dict[str, Any]:
    """Return date, program, command (empty if it is none of the command line) and machine of a run."""
    return {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "version": __version__,
        "commit": commit_of(_ROOT),
        "command": shlex.join(("groundstation", *command)) if command else None,
        "machine": {
            "name": platform.node(),
            "system": platform.platform(),
            "processor": _processor(),
            "cores": os.cpu_count(),
        },
    }


def file_provenance(file: Path) -> dict[str, Any]:
    """Return the path of a file and its hash, None where it cannot be read."""
    real = Path(os.path.realpath(file))
    return {"path": str(real), "sha256": hash_of([real])}


def _inputs(path: Path, session: Session) -> list[Path]:
    """Return the files of a session: a recording, or a folder's tables, videos and pictures, without results in it."""
    if session.recorded is not None:
        return [Path(os.path.realpath(session.recorded.path))]
    results = set(REPLAY_FILES) - {"detections.csv"} if session.detections_only else set(REPLAY_FILES)
    folders = [path, *(medium.path for medium in session.media.values() if medium.path.is_dir())]
    try:
        files = [file for folder in folders for file in sorted(folder.iterdir()) if file.is_file()]
    except OSError:
        return [path / "session.toml"]
    return [file for file in files if not any(file.match(pattern) for pattern in results)]


def hash_of(files: Sequence[Path]) -> str | None:
    """Return one SHA-256 over the names, sizes and contents of files, in order; None if one cannot be read.

    Of a file of more than 256 MB 64 blocks of 1 MB are hashed, evenly spread over it, instead of all. The hash
    of files that have not changed is remembered in this process: an evaluation replays a session several times.
    """
    try:
        known = tuple((str(file), _state(file)) for file in files)
        settled_ns = time.time_ns() - _SETTLED_NS
        # a file that could not be read is not remembered
        return (_remembered if all(changed_ns < settled_ns for _, (*_, changed_ns) in known) else _hash_now)(known)
    except OSError:
        return None


def _state(file: Path) -> tuple[int, int, int, int, int]:
    """Return what is another once a file is changed, the time of its last change at the end."""
    found = file.stat()
    return found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns, found.st_ctime_ns


def _hash_now(files: tuple[tuple[str, tuple[int, ...]], ...]) -> str:
    """Return the hash of files, whose states do not matter here; raises `OSError`."""
    total = hashlib.sha256()
    for name, _ in files:
        file = Path(name)
        size = file.stat().st_size
        total.update(f"{file.name}\0{size}\0".encode())
        with file.open("rb") as stream:
            for start, end in _parts(size):
                stream.seek(start)
                while block := stream.read(min(end - stream.tell(), _READ_BYTES)):
                    total.update(block)
    return total.hexdigest()


_remembered = lru_cache(maxsize=16)(_hash_now)


def _parts(size: int) -> Iterable[tuple[int, int]]:
    """Return the parts of a file that are hashed, as start and end."""
    if size <= _WHOLE_BYTES:
        return [(0, size)]
    step = (size - _BLOCK_BYTES) / (_BLOCKS - 1)
    return [(round(k * step), round(k * step) + _BLOCK_BYTES) for k in range(_BLOCKS)]


def commit_of(root: Path) -> str | None:
    """Return the commit of a checkout, with "-dirty" if it is changed; None outside of one, or without git."""
    if not (root / ".git").exists():
        return None
    command = ["git", "-C", str(root), "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"]
    try:
        found = subprocess.run(command, capture_output=True, text=True, timeout=_GIT_S, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return found.stdout.strip() or None if found.returncode == 0 else None


def _processor() -> str:
    """Return the processor's name as the system states it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()
