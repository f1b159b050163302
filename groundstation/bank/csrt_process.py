"""OpenCV's CSRT tracker in a process of another Python, since OpenCV 5 has it no more.

That Python has ``opencv-contrib-python-headless`` below 5 and nothing of ours.
"""

import os
import subprocess
from pathlib import Path

import numpy as np

from groundstation.arrays import ImageArray
from groundstation.box import Box, box_of_size
from groundstation.errors import InputError, os_words

_WANTED = "a Python with opencv-contrib-python-headless below 5, which has CSRT"
_CHECK = "import cv2; cv2.TrackerCSRT_create()"
_CHECK_S = 60.0


def require_csrt(python: Path) -> None:
    """Raise `InputError` unless a Python has OpenCV's CSRT."""
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    try:
        command = [str(python), "-c", _CHECK]
        done = subprocess.run(command, env=environment, capture_output=True, check=False, timeout=_CHECK_S)
    except (OSError, subprocess.TimeoutExpired) as fault:
        raise InputError(str(python), got=os_words(fault), wanted=_WANTED) from fault
    if done.returncode != 0:
        raise InputError(str(python), got="a program that has no CSRT", wanted=_WANTED)


class CsrtProcess:
    """One tracker; ``python`` is the executable of the environment that has it."""

    def __init__(self, python: Path) -> None:
        self._python = python
        environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
        worker = [str(python), str(Path(__file__).with_name("csrt_worker.py"))]
        try:
            self._process = subprocess.Popen(worker, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment)
        except OSError as fault:
            raise InputError(str(python), got=os_words(fault), wanted=_WANTED) from fault

    def __enter__(self) -> "CsrtProcess":
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.communicate()

    def start(self, image: ImageArray, box: Box[float]) -> None:
        """Begin in a box, px."""
        self._ask(f"{image.shape[1]} {image.shape[0]} {box.x0} {box.y0} {box.w} {box.h}", image)

    def update(self, image: ImageArray) -> tuple[float, Box[float] | None]:
        """Return the processor time of an update in s, and the box found in the next image; None where it is lost."""
        elapsed, *found = self._ask("next", image)
        if len(found) != 4:
            return elapsed, None
        return elapsed, box_of_size(*found)

    def _ask(self, head: str, image: ImageArray) -> list[float]:
        stdin, stdout = self._process.stdin, self._process.stdout
        if stdin is None or stdout is None:
            raise InputError(str(self._python), got="no pipes to it", wanted="a process that can be talked to")
        try:
            stdin.write(head.encode() + b"\n" + np.ascontiguousarray(image).tobytes())
            stdin.flush()
            answer = stdout.readline().split()
        except OSError:
            answer = []
        if not answer:
            raise InputError(
                str(self._python),
                got="a process that ended",
                wanted=_WANTED,
            )
        return [float(v) for v in answer]
