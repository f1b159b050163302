"""The weights of the learned channel and of the proposal network: files of the program, as fixed as its code."""

import hashlib
from functools import cache
from pathlib import Path

from groundstation.errors import InputError, os_words
from groundstation.files.toml_table import shown

_FOLDER = Path(__file__).resolve().parents[1] / "detection" / "weights"
WEIGHTS, PROPOSAL_WEIGHTS = _FOLDER / "aircraft.onnx", _FOLDER / "proposals.onnx"
# of the file that docs/learned-channel.md describes
SHA256 = "8f78716efd09e86a5d5632f959a5f965b0e6f1964c72b44dbe9e43f86d13dcbb"
PROPOSAL_SHA256 = "5df657221ff94c51f99caadc11a43e786a5004525616d055ba6b5101aefe663e"
MOST_BYTES = 2_000_000


# one's own weights by their SHA-256: a tuning, which a recording may bring, names a hash and never a path
_own: dict[str, bytes] = {}


def add_weights(path: Path) -> str:
    """Read one's own weights for this process and return their SHA-256, by which a tuning names them.

    Raises `InputError` as `read_weights` does.
    """
    content = read_weights(path, None)
    sha256 = hashlib.sha256(content).hexdigest()
    _own[sha256] = content
    return sha256


def channel_weights(sha256: str = "") -> bytes:
    """Return the weights with a hash, by default those of the program.

    Raises `InputError` where the program's file is missing or another one, and for a hash that `add_weights` has not
    seen.
    """
    if sha256 in ("", SHA256):
        return _weights_of_the_program()
    if sha256 not in _own:
        got = f"SHA-256 {shown(sha256, 16)}…, which is not of this program's weights"
        raise InputError("detection.weights_sha256", got=got, wanted="the option --weights with that file")
    return _own[sha256]


@cache
def _weights_of_the_program() -> bytes:
    return read_weights(WEIGHTS, SHA256)


@cache
def proposal_weights() -> bytes:
    """Return the program's weights of the proposal network; raises `InputError` where they are missing or others."""
    return read_weights(PROPOSAL_WEIGHTS, PROPOSAL_SHA256)


def read_weights(path: Path, sha256: str | None) -> bytes:
    """Return an ONNX file's content; ``sha256`` is what its hash has to be, None accepts any.

    Raises `InputError` for a file that cannot be read, is too large, or has another hash.
    """
    wanted = "weights of a network" if sha256 is None else f"weights with SHA-256 {sha256[:16]}…"
    try:
        size = path.stat().st_size
        content = path.read_bytes() if size <= MOST_BYTES else b""
    except OSError as fault:
        raise InputError(str(path), got=os_words(fault), wanted=wanted) from fault
    if size > MOST_BYTES:
        raise InputError(str(path), got=f"{size} bytes", wanted=f"at most {MOST_BYTES}")
    found = hashlib.sha256(content).hexdigest()
    if sha256 is not None and found != sha256:
        raise InputError(str(path), got=f"SHA-256 {found[:16]}…", wanted=wanted)
    return content
