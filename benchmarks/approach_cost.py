"""Processor time that watching an approach adds to each pair: advice, deviations, touchdown foretold.

usage: python benchmarks/approach_cost.py [--flights N]

Landings in gusts, 30 pairs a second, by the thread's own processor time: another process does not count. The forecast,
twice a second, is the longest part; an answer to a pair is given before it.
"""

import argparse
import time

import numpy as np
from landing_flights.tracked_approach import SITE, gusty_landing, watched

from groundstation.approach.approach_outputs import ApproachOutputs
from groundstation.cli.number_arguments import count
from groundstation.simulation.flights import SPAN_M, FlightModelKind, site_rig

_PAIRS_HZ, _WIND_M_S = 30.0, 6.0


def main() -> None:
    """Print the pipeline's and the approach's time of a pair."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--flights", type=count, default=3, metavar="N", help="landings (default: 3)")
    spent: dict[str, list[float]] = {"pipeline": [], "approach": []}
    for seed in range(parser.parse_args().flights):
        pipeline, events = watched(gusty_landing(seed, _WIND_M_S, FlightModelKind.WAVES), seed, _PAIRS_HZ)
        outputs = ApproachOutputs(site_rig(), SPAN_M, SITE)
        for event in events:
            times = [time.thread_time()]
            report = pipeline.step(event)
            times.append(time.thread_time())
            outputs.note(report, event.t_s)
            outputs.pass_time(event.t_s)
            times.append(time.thread_time())
            if report.estimates:
                for name, value in zip(spent, np.diff(times), strict=True):
                    spent[name].append(1e3 * value)
    for name, values in spent.items():
        p50, p99 = np.percentile(values, [50, 99])
        print(f"{name}: {len(values)} pairs, median {p50:.2f} ms, 99 % {p99:.2f} ms, most {max(values):.2f} ms")


if __name__ == "__main__":
    main()
