"""What is left of encoders' errors between the frames that tell the angles: noise, a wrong zero, gears.

    python benchmarks/encoder_offsets.py

Angles alone: an encoder of 0.02°, 30 frames a second for half a minute, every sixth of which tells the angle to
0.0003°; the head stands, or turns by 0.5 and 2°/s. Printed is the rms between them, in brackets without the correction,
from the third second on.
"""

from collections.abc import Callable

import numpy as np

from groundstation.estimation.encoder_offset import OffsetEstimator
from groundstation.messages import FrameAngles

SIGMA_DEG, TOLD_DEG = 0.02, 0.0003
FRAMES, FIRST, EVERY, RATE_HZ = 900, 90, 6, 30.0
RATES_DEG_S = (0.0, 0.5, 2.0)


def gear(period_deg: float) -> Callable[[float], float]:
    """Return the error, deg, by the angle, of an rms of the encoder's sigma."""
    return lambda pan_deg: float(np.sqrt(2.0) * SIGMA_DEG * np.sin(2.0 * np.pi * pan_deg / period_deg))


def left_over(error: Callable[[float], float], noise_deg: float, rate_deg_s: float) -> tuple[float, float]:
    """Return the rms of the readings between, corrected and as read, deg."""
    random, estimator = np.random.default_rng(3), OffsetEstimator(float(np.radians(SIGMA_DEG)))
    corrected, read = [], []
    for k in range(FRAMES):
        pan_deg = rate_deg_s * k / RATE_HZ + 1.7
        off_deg = error(pan_deg) + float(random.normal(0.0, noise_deg))
        pan = float(np.radians(pan_deg))
        if k % EVERY == 0:
            told = FrameAngles(
                t_s=k / RATE_HZ, station="left", pan_rad=pan, tilt_rad=0.0, sigma_rad=float(np.radians(TOLD_DEG))
            )
            estimator.take(float(np.radians(pan_deg + off_deg)), 0.0, 1.0, told)
        elif k > FIRST:
            read.append(off_deg)
            corrected.append(off_deg - float(np.degrees(estimator.offset.near(pan, 0.0)[0])))
    return float(np.sqrt(np.mean(np.square(corrected)))), float(np.sqrt(np.mean(np.square(read))))


def main() -> None:
    cases: dict[str, tuple[Callable[[float], float], float]] = {
        "constant": (lambda pan_deg: SIGMA_DEG, 0.1 * SIGMA_DEG),
        "gear, 12°": (gear(12.0), 0.1 * SIGMA_DEG),
        "gear, 3°": (gear(3.0), 0.1 * SIGMA_DEG),
        "noise": (lambda pan_deg: 0.0, SIGMA_DEG),
    }
    for words, (error, noise_deg) in cases.items():
        row = ("{:.4f} ({:.4f})".format(*left_over(error, noise_deg, rate)) for rate in RATES_DEG_S)
        print(words, *row, sep=", ")


if __name__ == "__main__":
    main()
