"""A job that reports a kernel as numba does before it compiles one; imported on the workers."""

import time

import numba  # noqa: F401 - what a job of kernels has imported

from groundstation.compilation import Compiling, report


def compile_two(item: int) -> int:
    for number in (1, 2):
        report(Compiling(kernel=f"detection.kernel_{number}", number=number, at_most=2))
    # long enough that each of two workers has one
    time.sleep(0.3)
    return item
