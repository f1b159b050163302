"""One program at a time writes its results into a folder."""

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from groundstation.errors import InputError


@contextmanager
def locked_folder(folder: Path) -> Iterator[None]:
    """Hold a folder, which exists, for the results of this process; the lock ends with the process at the latest.

    The lock is on the folder itself, so it leaves no file. Raises `InputError` while another process holds it.
    """
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        os.close(descriptor)
        got = "a folder into which another run writes at present"
        raise InputError(str(folder), got=got, wanted="a folder of its own") from error
    except OSError:
        # a file system without locks, as some network ones: then there is none
        pass
    try:
        yield
    finally:
        os.close(descriptor)
