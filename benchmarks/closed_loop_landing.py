"""Landings flown by an autopilot on the stream alone, against the same landings on the true state.

usage: python benchmarks/closed_loop_landing.py [--landings N] [--gust M_S] [--wind M_S] [--receiver TEXT] [--workers N]

JSBSim's C172 at a span of 2.3 m, a plain autopilot (`groundstation.simulation.flown_landing`), two stations whose heads
follow it, cameras at the level of pixels, a radio that loses 5 % and delays by 30 to 200 ms, and the receiver's rules.
Both landings of a seed have the same wind, gusts, sensors' errors and start. The autopilot's gains were chosen on the
true state alone, with other seeds. Errors are of the part below 20 m. An approach that does not touch down is in no
mean, and is counted.
"""

import argparse
from typing import Any

import numpy as np
from parallel_study import StudyRun, add_study_arguments, as_json, in_blocks

from groundstation.arrays import FloatArray
from groundstation.cli.number_arguments import count, parse_number
from groundstation.simulation.autopilot_receivers.landing_streams import RECEIVERS
from groundstation.simulation.flown_landing.gusty_wind import WindStrength
from groundstation.simulation.flown_landing.landing_flight import LandingOutcome, LandingSetup, land_on_true_state
from groundstation.simulation.flown_landing.landing_on_stream import DEFAULT_RECEIVER, LandingOnStream, land_on_stream

_BLOCK = 2
_RESAMPLED = 10_000
# a sink that a small aircraft's gear takes
_HARD_M_S = 1.5


def landed(job: tuple[list[int], float, float, str]) -> list[dict[str, Any]]:
    """Return what became of each landing on the true state and on the stream."""
    seeds, gust_m_s, wind_m_s, receiver = job
    setup = LandingSetup(wind=WindStrength(most_mean_m_s=wind_m_s, gust_m_s=gust_m_s))
    found = []
    for seed in seeds:
        streamed = land_on_stream(setup, seed, receiver=receiver)
        found.append(
            {
                "true": as_json(land_on_true_state(setup, seed)),
                "stream": as_json(streamed.landing),
                **_errors(streamed),
            }
        )
    return found


def _errors(streamed: LandingOnStream) -> dict[str, Any]:
    return {
        "station": (streamed.station_errors_m**2).sum(axis=0).tolist(),
        "estimates": len(streamed.station_errors_m),
        "vehicle": (streamed.vehicle_errors_m**2).sum(axis=0).tolist(),
        "steps": len(streamed.vehicle_errors_m),
        "samples": streamed.samples,
        "late": streamed.late,
        "gap_s": streamed.longest_gap_s,
    }


def summary(flights: list[dict[str, Any]]) -> str:
    """Return the lines of the study."""
    lines = []
    for name, n in (("station", "estimates"), ("vehicle", "steps")):
        rms = np.sqrt(sum(np.array(f[name]) for f in flights) / max(sum(f[n] for f in flights), 1))
        worst = max((float(np.sqrt(f[name][2] / f[n])) for f in flights if f[n]), default=float("nan"))
        lines.append(
            f"{name}'s position below 20 m: rms error up {rms[2]:.3f} m (worst landing {worst:.3f}), "
            f"across {rms[0]:.3f}, along {rms[1]:.3f}"
        )
    for name in ("true", "stream"):
        lines.append(_outcomes(name, [f[name] for f in flights]))
    both = [f for f in flights if all(f[name]["outcome"] == LandingOutcome.TOUCHDOWN for name in ("true", "stream"))]
    lines.append(f"of {len(both)} that touched down on both:")
    true, stream = (np.array([f[name]["touchdown_m"] for f in both]).reshape(-1, 2) for name in ("true", "stream"))
    lines += [_scatter(axis, true[:, k], stream[:, k]) for k, axis in enumerate(("along", "across"))]
    samples, late = (sum(f[name] for f in flights) for name in ("samples", "late"))
    lines.append(
        f"positions taken {samples}, too late for the filter {late}; "
        f"longest time without one {max(f['gap_s'] for f in flights):.2f} s"
    )
    return "\n".join(lines)


def _outcomes(name: str, of: list[dict[str, Any]]) -> str:
    tally = ", ".join(f"{sum(f['outcome'] == o for f in of)} {o.value}" for o in LandingOutcome)
    sinks = np.array([f["sink_m_s"] for f in of if f["outcome"] == LandingOutcome.TOUCHDOWN])
    if not len(sinks):
        return f"{name}: {tally}"
    return (
        f"{name}: {tally}; sink at touchdown {sinks.mean():.2f} m/s, largest {sinks.max():.2f}, "
        f"{int((sinks > _HARD_M_S).sum())} above {_HARD_M_S:g}"
    )


def _scatter(axis: str, true: FloatArray, stream: FloatArray) -> str:
    """Return means, sigmas and the sigmas' ratio with its interval: both landings of a seed are drawn together."""
    if len(true) < 3:
        return f"  {axis}: too few"
    generator = np.random.default_rng(421)
    drawn = generator.integers(len(true), size=(_RESAMPLED, len(true)))
    ratios = stream[drawn].std(axis=1, ddof=1) / np.maximum(true[drawn].std(axis=1, ddof=1), 1e-9)
    low, high = np.quantile(ratios, [0.025, 0.975])
    sigmas = [float(values.std(ddof=1)) for values in (true, stream)]
    apart = stream - true
    return (
        f"  {axis}: mean {true.mean():.2f} m true, {stream.mean():.2f} stream; sigma {sigmas[0]:.2f} m true, "
        f"{sigmas[1]:.2f} stream, ratio {sigmas[1] / sigmas[0]:.2f} (95 %: {low:.2f} … {high:.2f}); "
        f"the two apart {apart.mean():+.2f} ± {apart.std(ddof=1):.2f} m"
    )


def _speed_m_s(text: str) -> float:
    return parse_number(text, "a number from 0 to 15", lambda value: 0.0 <= value <= 15.0)


def main() -> None:
    """Print the errors, the scatter of the touchdowns and the outcomes."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--landings", type=count, default=40, metavar="N", help="seeds from 0 on (default: 40)")
    parser.add_argument("--gust", type=_speed_m_s, default=6.0, metavar="M_S", help="largest gust (default: 6)")
    parser.add_argument("--wind", type=_speed_m_s, default=6.0, metavar="M_S", help="largest mean wind (default: 6)")
    parser.add_argument(
        "--receiver", default=DEFAULT_RECEIVER, metavar="TEXT", help="one whose name contains it (default: GPS_INPUT)"
    )
    add_study_arguments(parser, "closed-loop-landing")
    options = parser.parse_args()
    receivers = [name for name in RECEIVERS if options.receiver in name]
    if not receivers:
        parser.error(f"--receiver: got {options.receiver!r}, wanted a part of one of: " + "; ".join(RECEIVERS))
    receiver = receivers[0]
    jobs = {f"{b[0]}": (b, options.gust, options.wind, receiver) for b in in_blocks(range(options.landings), _BLOCK)}
    values = StudyRun.chosen("closed-loop-landing", options).values(landed, jobs)
    print(f"{receiver}, gusts to {options.gust:g} m/s, mean wind to {options.wind:g} m/s")
    print(summary([flight for block in values.values() for flight in block]))


if __name__ == "__main__":
    main()
