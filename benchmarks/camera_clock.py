"""A camera's clock fitted to arrivals that are late in eight ways: error, stated sigma, and the arrivals themselves.

    python benchmarks/camera_clock.py [--draws N]

30 frames/s, drift of 30 ppm (1 σ), any offset. After 6, 20 and 90 s: rms of the last frame's error over the draws,
median of the sigma stated, mean of (error/σ)², and the rms of the arrivals about their mean, which is what a fit of a
constant to them would leave. Seeded; no clock is read.
"""

import argparse
from collections.abc import Callable

import numpy as np

from groundstation.sources.cameras.host_clock_fit import ClockFit

DELAYS: dict[str, Callable[[np.random.Generator, int], np.ndarray]] = {
    "exponential, 2 ms": lambda r, n: r.exponential(2e-3, n),
    "half normal, 2 ms": lambda r, n: np.abs(r.normal(0, 2e-3, n)),
    "uniform, 0 to 4 ms": lambda r, n: r.uniform(0, 4e-3, n),
    "gamma, shape 2, mean 2 ms": lambda r, n: r.gamma(2, 1e-3, n),
    "gamma, shape 4, mean 2 ms": lambda r, n: r.gamma(4, 0.5e-3, n),
    "log normal about 1 ms": lambda r, n: 1e-3 * np.exp(r.normal(0, 1, n)),
    "every second frame 80 ms late": lambda r, n: r.exponential(2e-4, n) + 0.08 * (r.random(n) < 0.5),
    "hiccups of 0.1 s": lambda r, n: r.exponential(2e-4, n) + (r.random(n) < 0.02) * r.exponential(0.1, n),
}
AT_S = (6.0, 20.0, 90.0)
RATE_HZ = 30.0


def one(kind: str, rng: np.random.Generator) -> list[tuple[float, float]]:
    """Error and sigma at each of `AT_S`."""
    n = int(AT_S[-1] * RATE_HZ)
    device_s = np.arange(n) / RATE_HZ
    truth = rng.uniform(-1e4, 1e4) + (1.0 + rng.normal(0.0, 30e-6)) * device_s
    arrivals = truth + DELAYS[kind](rng, n)
    fit, found = ClockFit(), []
    for i in range(n):
        reading = fit.take(10**15 + round(device_s[i] * 1e9), float(arrivals[i]))
        if any(i + 1 == int(s * RATE_HZ) for s in AT_S):
            found.append((reading.t_s - truth[i], reading.sigma_s))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=40)
    draws = parser.parse_args().draws
    heads = " | ".join(f"{s:g} s: error, σ in ms, (e/σ)²" for s in AT_S)
    print(f"| delay | arrivals | {heads} |")
    print("|---|---|" + "---|" * len(AT_S))
    for number, kind in enumerate(DELAYS):
        rng = np.random.default_rng([7, number])
        raw = DELAYS[kind](rng, 100_000).std()
        table = np.array([one(kind, rng) for _ in range(draws)])
        cells = []
        for k in range(len(AT_S)):
            error, sigma = table[:, k, 0], table[:, k, 1]
            rms = np.sqrt(np.mean(error**2))
            cells.append(f"{rms * 1e3:.3f}, {np.median(sigma) * 1e3:.3f}, {np.mean((error / sigma) ** 2):.2f}")
        print(f"| {kind} | {raw * 1e3:.2f} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
