"""Run OpenCV's CSRT tracker over the frames that come in on standard input, and answer with its times.

Started by `CsrtProcess` with another Python: CSRT is in opencv-contrib-python-headless below 5 only. Each request is a
line `W H X Y W H`, to begin in a box, or `next`, then the frame as raw bytes; each answer is a line: the processor time
of the update in s, and the box, or nothing where it was lost.
"""

import sys
import time
from typing import Any

import cv2
import numpy as np


def _answer(*values: float) -> None:
    sys.stdout.write(" ".join(str(v) for v in values) + "\n")
    sys.stdout.flush()


def main() -> None:
    """Answer requests until standard input ends."""
    cv2.setNumThreads(1)
    tracker: Any = None
    size = (0, 0)
    requests = sys.stdin.buffer
    while line := requests.readline().split():
        if line[0] != b"next":
            size = (int(line[0]), int(line[1]))
        image = np.frombuffer(requests.read(3 * size[0] * size[1]), np.uint8).reshape(size[1], size[0], 3)
        if line[0] != b"next":
            tracker = cv2.TrackerCSRT_create()  # type: ignore[attr-defined]
            tracker.init(image, tuple(round(float(v)) for v in line[2:6]))
            _answer(0)
            continue
        began = time.process_time()
        good, box = tracker.update(image)
        elapsed = time.process_time() - began
        _answer(elapsed, *(box if good else ()))


if __name__ == "__main__":
    main()
