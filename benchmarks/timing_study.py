"""`groundstation calibrate timing` on made-up swings: the offset's error against its bound and its claimed sigma.

    python benchmarks/timing_study.py [--swings 100]

Each swing has its own phase of stamps, offset, amplitudes and noise; the bound has the sines' amplitudes, phases, rates
and means free, too.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
from scipy.stats import chi2

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from calibration.clocks.ptu_clock_fit import solve_timing
from tests.calibration.clocks.swings import Recorder, Swing, offset_bound, recorded

CASES = {
    "5 deg, 0.4 Hz, 15 s, 15 Hz pictures": (Swing(pan_deg=5.0), Recorder(seconds=15.0)),
    "2 deg, 0.2 Hz, 20 s, 10 Hz pictures": (Swing(pan_deg=2.0, pan_hz=0.2), Recorder(seconds=20.0, frame_hz=10.0)),
    "5 deg, 0.4 Hz, readings at 20 Hz": (Swing(pan_deg=5.0), Recorder(reading_hz=20.0)),
    "the same, pictures to 0.005 deg": (Swing(pan_deg=5.0), Recorder(reading_hz=50.0, turn_deg=0.005)),
    "steps of 0.00625 deg, 40 s, 80 ppm": (Swing(pan_deg=4.0), Recorder(seconds=40.0, step_deg=0.00625, drift=8e-5)),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--swings", type=int, default=100)
    options = parser.parse_args()
    n = options.swings
    low, high = chi2.ppf([0.001, 0.999], n) / n
    print(f"{n} swings each; chi2/n of errors over claimed sigmas, 99.8 % of such: {low:.2f} to {high:.2f}")
    print(f"{'case':<40}{'rms error':>12}{'bound':>10}{'ratio':>8}{'chi2/n':>9}")
    for case, (swing, how) in CASES.items():
        errors, sigmas = [], []
        for seed in range(n):
            rng = np.random.default_rng([7, seed])
            made = Recorder(
                **{**{f: getattr(how, f) for f in Recorder.__slots__}, "offset_s": rng.uniform(-0.08, 0.08)}
            )
            readings, motion = recorded(swing, made, rng)
            fit = solve_timing("left", readings, motion, np.radians(0.01))
            errors.append(fit.offset_s - made.offset_s)
            sigmas.append(fit.sigma_s)
        bound = offset_bound(swing, how)
        rms = float(np.sqrt(np.mean(np.square(errors))))
        square = float(np.mean(np.square(np.array(errors) / sigmas)))
        print(f"{case:<40}{1e6 * rms:>9.1f} us{1e6 * bound:>7.1f} us{rms / bound:>8.2f}{square:>9.2f}", flush=True)


if __name__ == "__main__":
    main()
