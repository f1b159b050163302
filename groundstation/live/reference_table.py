"""``dgps.csv`` of an operation: each position of the reference receiver, written as it comes."""

import math
import threading
from pathlib import Path

import numpy as np

from groundstation.errors import os_words
from groundstation.files.line_file import LineFile
from groundstation.messages import DgpsFix

_HEADER = "t_s,x_m,y_m,z_m,sigma_x_m,sigma_y_m,sigma_z_m,status\n"
_FLUSH_S = 0.5


class DgpsTable:
    """Writes ``dgps.csv``, antenna positions at session time; one that the disk refuses ends it.

    Parameters
    ----------
    path : of the table; made with its first row.
    faults : called once, if the disk takes no more.
    """

    def __init__(self, path: Path, faults: list[str]) -> None:
        self._path, self._faults = path, faults
        self._file: LineFile | None = None
        self._failed = False
        self._flushed_s = -math.inf
        self._lock = threading.Lock()

    def write(self, fix: DgpsFix) -> None:
        """Write one row; never raises."""
        with self._lock:
            if self._failed:
                return
            try:
                if self._file is None:
                    self._file = LineFile(self._path)
                    self._file.write(_HEADER)
                sigma = np.zeros(0) if fix.sigma_m is None else fix.sigma_m
                cells = [f"{fix.t_s:.6f}", *(f"{float(v):.4f}" for v in (*fix.position_runway_m, *sigma)), fix.status]
                self._file.write(",".join(cells) + "\n")
                if fix.t_s - self._flushed_s >= _FLUSH_S:
                    self._flushed_s = fix.t_s
                    self._file.flush()
            except OSError as fault:
                self._failed = True
                self._faults.append(f"dgps.csv ends here: {os_words(fault)}")

    def close(self) -> bytes | None:
        """Close it; returns its content, None if there is nothing whole."""
        with self._lock:
            file, self._file = self._file, None
            if file is None:
                return None
            try:
                file.close()
                return None if self._failed else self._path.read_bytes()
            except OSError as fault:
                self._faults.append(f"dgps.csv is not whole: {os_words(fault)}")
                return None
