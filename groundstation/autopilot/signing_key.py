"""The key of MAVLink message signing, from a file."""

import hashlib
import stat
from pathlib import Path

from groundstation.errors import ConfigError, os_words

_HEX_DIGITS = 64
_SHORTEST, _LONGEST = 8, 1024


def read_signing_key(path: Path) -> bytes:
    """Return the 32 bytes of a key file: 64 hexadecimal digits, or a passphrase, whose SHA-256 is the key.

    The passphrase is what MAVProxy and Mission Planner ask for. Raises `ConfigError`, also where others may read it.
    """
    wanted = f"a file of {_HEX_DIGITS} hexadecimal digits, or of a passphrase of {_SHORTEST} characters and more"
    try:
        with path.open("rb") as file:
            mode = path.stat().st_mode
            content = file.read(_LONGEST + 1)
        text = content.decode().strip()
    except (OSError, UnicodeDecodeError) as fault:
        raise ConfigError(str(path), got=os_words(fault), wanted=wanted) from fault
    if not _SHORTEST <= len(text) <= _LONGEST or not text.isprintable():
        raise ConfigError(str(path), got=f"{len(text)} characters", wanted=wanted)
    if mode & (stat.S_IRGRP | stat.S_IROTH):
        raise ConfigError(str(path), got="a key that others may read", wanted=f"chmod 600 {path}")
    if len(text) == _HEX_DIGITS:
        try:
            return bytes.fromhex(text)
        except ValueError:
            pass
    return hashlib.sha256(text.encode()).digest()
