"""Whole simulated landings streamed to receivers with the autopilots' rules: what they refuse, and how far off it is.

usage: python benchmarks/autopilot_stream.py [--flights N] [--wind M_S] [--workers N]

Two stations follow each landing by their own heads, with cameras at the level of pixels through the live core. Each
receiver hears its own stream over a radio that loses 5 % and delays each message by 30 to 200 ms. The error of a sample
is its distance from the truth at the time to which the vehicle attributes it; the zero-delay filter's is that of the
pipeline's estimates at their own stamps, over the same part of the flight. The last line of each receiver is to be 1 at
most: what it is told of the error, after its parameters' lower bounds, may not be less than the error.
"""

import argparse
from collections import Counter
from typing import Any

import numpy as np
from landing_flights.tracked_approach import gusty_landing
from parallel_study import StudyRun, add_study_arguments, in_blocks

from groundstation.cli.number_arguments import count
from groundstation.simulation.autopilot_receivers.landing_streams import RECEIVERS, streamed_landing
from groundstation.simulation.flights import FlightModelKind

_BLOCK = 5


def streamed(job: tuple[list[int], float]) -> list[dict[str, Any]]:
    """Return what each receiver took of each landing."""
    seeds, wind_m_s = job
    found = []
    for seed in seeds:
        landing = gusty_landing(seed, wind_m_s, FlightModelKind.WAVES)
        streams = streamed_landing(landing.trajectory, landing.touchdown_s, seed)
        found.append(
            {
                name: {
                    "verdicts": {verdict.value: n for verdict, n in of.verdicts.items()},
                    "lost": of.lost,
                    "squares": of.squares_m2.tolist(),
                    "samples": of.samples,
                    "misdated_s": of.misdated_s,
                    "longest_gap_s": of.longest_gap_s,
                    "normalised": of.normalised.tolist(),
                    "zero_delay": of.zero_delay_m2.tolist(),
                    "estimates": of.estimates,
                }
                for name, of in streams.items()
            }
        )
    return found


def summary(name: str, flights: list[dict[str, Any]]) -> str:
    """Return the lines of a receiver."""
    mine = [flight[name] for flight in flights]
    verdicts = sum((Counter(f["verdicts"]) for f in mine), Counter[str]())
    rms = np.sqrt(sum(np.array(f["squares"]) for f in mine) / sum(f["samples"] for f in mine))
    zero = np.sqrt(sum(np.array(f["zero_delay"]) for f in mine) / sum(f["estimates"] for f in mine))
    normalised = np.sqrt(sum(np.array(f["normalised"]) for f in mine) / sum(f["samples"] for f in mine))
    samples = sum(f["samples"] for f in mine)
    late_s, late_s2 = (sum(f["misdated_s"][k] for f in mine) / samples for k in range(2))
    gap_s = max(f["longest_gap_s"] for f in mine)
    all_axes = np.linalg.norm(rms) / np.linalg.norm(zero)
    good = {"accepted", "the first of a series"}
    clean = sum(set(f["verdicts"]) <= good for f in mine)
    tally = ", ".join(f"{n} {verdict}" for verdict, n in verdicts.most_common())
    return (
        f"{name}\n  landings without a refusal other than by loss: {clean} of {len(mine)}; "
        f"lost {sum(f['lost'] for f in mine)}, {tally}; longest gap {gap_s:.2f} s\n"
        f"  taken to be later than it is by {1e3 * late_s:.0f} ms, "
        f"one sigma {1e3 * (late_s2 - late_s**2) ** 0.5:.0f} ms\n"
        f"  rms error across, along, up: {rms[0]:.3f} {rms[1]:.3f} {rms[2]:.3f} m; "
        f"over the zero-delay filter's {rms[0] / zero[0]:.2f} {rms[1] / zero[1]:.2f} {rms[2] / zero[2]:.2f}, "
        f"all axes {all_axes:.2f}\n"
        f"  rms error over the sigma that the receiver takes, horizontal, vertical: "
        f"{normalised[0]:.2f} {normalised[1]:.2f}"
    )


def main() -> None:
    """Print the tally and the errors of each receiver."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--flights", type=count, default=100, metavar="N", help="landings (default: 100)")
    parser.add_argument("--wind", type=float, default=6.0, metavar="M_S", help="whose gusts (default: 6)")
    add_study_arguments(parser, "autopilot-stream")
    options = parser.parse_args()
    jobs = {f"{b[0]}": (b, options.wind) for b in in_blocks(range(options.flights), _BLOCK)}
    values = StudyRun.chosen("autopilot-stream", options).values(streamed, jobs)
    flights = [flight for block in values.values() for flight in block]
    for name in RECEIVERS:
        print(summary(name, flights))


if __name__ == "__main__":
    main()
