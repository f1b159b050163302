"""The touchdown foretold: is it inside its ellipse, and how much wider is that than with the true state?

usage: python benchmarks/touchdown_study.py [--flights N] [--wind M_S] [--workers N] [KIND …]

Flights are tracked from pixels through the whole pipeline (benchmarks/landing_flights). Kinds: `prior`, landings drawn
from the stated prior; `waves` and `jsbsim`, landings of the simulation in gusts, which the prior knows nothing of;
`free`, the first foretold without their plan; `flaring`, without it, and with `free_flare_share` 1. The same predictor
is fed with the estimate and with the true state, at 10, 5 and 2 s before the true touchdown.
"""

import argparse
from typing import Any

import numpy as np
from landing_flights.tracked_approach import SITE, WHEELS, Landing, gusty_landing, prior_landing, track
from parallel_study import StudyRun, add_study_arguments, in_blocks
from scipy.stats import binom

from groundstation.cli.number_arguments import count
from groundstation.landing.touchdown import TouchdownForecast, TouchdownPredictor
from groundstation.landing_site.approach_prior import ApproachPrior
from groundstation.landing_site.landing_site_file import LandingSite
from groundstation.messages import Kinematics
from groundstation.simulation.flights import FlightModelKind

BEFORE_S = (10.0, 5.0, 2.0)
# flights of each kind: the stated prior's are the target's, the others show what becomes of it
_FLIGHTS = {"prior": 400, "waves": 100, "jsbsim": 100, "free": 100, "flaring": 100}
KINDS = tuple(_FLIGHTS)
_BLOCK = 10
_LIKE_TRUTH = 1e-6


def landing_of(kind: str, seed: int, wind_m_s: float) -> Landing:
    """Return one landing of a kind."""
    if kind in ("prior", "free", "flaring"):
        return prior_landing(seed)
    return gusty_landing(seed, wind_m_s, FlightModelKind(kind))


def foretold(job: tuple[str, list[int], float]) -> list[list[dict[str, Any] | None]]:
    """Return, for each flight, what was foretold so long before the touchdown; None without a forecast."""
    kind, seeds, wind_m_s = job
    site = SITE
    if kind in ("free", "flaring"):
        share = 1.0 if kind == "flaring" else 0.0
        site = LandingSite(runway=SITE.runway, prior=ApproachPrior(free_flare_share=share))
    predictor = TouchdownPredictor(site, WHEELS)
    found = []
    for seed in seeds:
        landing = landing_of(kind, seed, wind_m_s)
        estimates = track(landing, seed).estimates()
        found.append([_compared(predictor, landing, estimates, before_s) for before_s in BEFORE_S])
    return found


def _compared(
    predictor: TouchdownPredictor, landing: Landing, estimates: list[tuple[float, Kinematics]], before_s: float
) -> dict[str, Any] | None:
    t_s, known = min(estimates, key=lambda e: abs(e[0] - (landing.touchdown_s - before_s)))
    at = np.array([t_s])
    true = Kinematics(
        position_runway_m=landing.trajectory.position(at)[0],
        velocity_runway_m_s=landing.trajectory.velocity(at)[0],
        covariance=_LIKE_TRUTH**2 * np.eye(6),
    )
    ours, best = predictor.forecast(t_s, known), predictor.forecast(t_s, true)
    if not (isinstance(ours, TouchdownForecast) and isinstance(best, TouchdownForecast)):
        return None
    return {
        "inside": ours.contains(landing.touchdown_m),
        "inside_true": best.contains(landing.touchdown_m),
        "off_m": (landing.touchdown_m - ours.point_m).tolist(),
        "late_s": landing.touchdown_s - ours.t_s,
        "sigma_s": ours.sigma_t_s,
        "sigma_m": np.sqrt(np.diag(ours.covariance_m2)).tolist(),
        "sigma_true_m": np.sqrt(np.diag(best.covariance_m2)).tolist(),
        "planned": ours.basis.value == "plan",
    }


def summary(kind: str, before_s: float, found: list[dict[str, Any] | None]) -> str:
    """Return one line for a time before the touchdown."""
    told = [f for f in found if f is not None]
    line = f"{kind:7s} {before_s:4.0f} s before: {len(told)} of {len(found)} foretold"
    if not told:
        return line
    inside = sum(f["inside"] for f in told)
    low, high = binom.ppf([0.025, 0.975], len(told), 0.95) / len(told)
    ours, best = (np.array([f[name] for f in told]) for name in ("sigma_m", "sigma_true_m"))
    rms = np.sqrt(np.mean(np.square(ours), axis=0))
    ratio = rms / np.sqrt(np.mean(np.square(best), axis=0))
    off = np.sqrt(np.mean(np.square([f["off_m"] for f in told]), axis=0))
    late = np.array([f["late_s"] / f["sigma_s"] for f in told])
    return (
        f"{line}, inside {100 * inside / len(told):.1f} % (95 % of samples: {100 * low:.1f} … {100 * high:.1f}), "
        f"with the true state {100.0 * np.mean([f['inside_true'] for f in told]):.1f} %; "
        f"sigma along/right {rms[0]:.1f}/{rms[1]:.2f} m, rms error {off[0]:.1f}/{off[1]:.2f} m; "
        f"sigma over that with the true state {ratio[0]:.3f}/{ratio[1]:.3f}, "
        f"flight by flight at most {np.max(ours / best):.2f}; time off {late.mean():+.2f} ± {late.std():.2f} sigma; "
        f"by the plan {sum(f['planned'] for f in told)}"
    )


def main() -> None:
    """Print a line for each kind and time."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kinds", nargs="*", metavar="KIND", help=", ".join(KINDS))
    parser.add_argument("--flights", type=count, metavar="N", help="of each kind (default: 400 of prior, 100 else)")
    parser.add_argument("--wind", type=float, default=6.0, metavar="M_S", help="of waves and jsbsim (default: 6)")
    add_study_arguments(parser, "touchdown")
    options = parser.parse_args()
    unknown = set(options.kinds) - set(KINDS)
    if unknown:
        parser.error(f"no kind {', '.join(sorted(unknown))}")
    kinds = options.kinds or KINDS
    jobs = {
        f"{kind}-{block[0]}": (kind, block, options.wind)
        for kind in kinds
        for block in in_blocks(range(options.flights or _FLIGHTS[kind]), _BLOCK)
    }
    values = StudyRun.chosen("touchdown", options).values(foretold, jobs)
    for kind in kinds:
        flights = [flight for name, block in values.items() if name.startswith(f"{kind}-") for flight in block]
        for k, before_s in enumerate(BEFORE_S):
            print(summary(kind, before_s, [flight[k] for flight in flights]))


if __name__ == "__main__":
    main()
