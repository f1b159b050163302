"""A picture of one landing: ellipses foretold one after the other, and how it kept to its glide path.

    python benchmarks/touchdown_sheet.py OUT.png [--seed SEED]

The landing is drawn from the stated prior and tracked from pixels through the whole pipeline.
"""

import argparse
from pathlib import Path

import matplotlib as mpl
import numpy as np
from landing_flights.tracked_approach import SITE, WHEELS, TrackedApproach, prior_landing, track

from groundstation.landing.landing_monitor import LandingMonitor, LandingStatus
from groundstation.landing.touchdown import TouchdownForecast

_BEFORE_S = (10.0, 8.0, 6.0, 4.0, 3.0, 2.0, 1.0)
_COLOURS = ("#440154", "#443983", "#31688e", "#21918c", "#35b779", "#90d743", "#c8b010")


def statuses_of(approach: TrackedApproach) -> list[LandingStatus]:
    """Return the status after each report that has one."""
    monitor = LandingMonitor(SITE, WHEELS, forecast_every_s=0.0)
    found = [monitor.step(report).status for report in approach.reports if report.estimates]
    return [status for status in found if status is not None]


def draw(approach: TrackedApproach, path: Path) -> None:
    """Draw the runway from above with the ellipses, and the deviation from the glide path under it."""
    mpl.use("Agg")
    from matplotlib import pyplot as plt  # after the backend

    statuses, down = statuses_of(approach), approach.landing
    figure, (above, beneath) = plt.subplots(2, 1, figsize=(8.0, 5.2), height_ratios=(3, 2), layout="constrained")
    edge = 0.5 * SITE.runway.width_m
    above.axhspan(-edge, edge, color="0.9", zorder=0)
    above.axvline(0.0, color="0.6", linewidth=0.8)
    for before_s, colour in zip(_BEFORE_S, _COLOURS, strict=True):
        status = min(statuses, key=lambda s: abs(s.t_s - (down.touchdown_s - before_s)))
        if isinstance(status.touchdown, TouchdownForecast):
            outline = status.touchdown.outline_m()
            above.plot(*np.vstack([outline, outline[:1]]).T, color=colour, label=f"{before_s:.0f} s before")
            above.plot(*status.touchdown.point_m, "+", color=colour)
    above.plot(*down.touchdown_m, "kx", markersize=9, label="touchdown")
    above.set_xlabel("past the threshold, m")
    above.set_ylabel("right of the centre line, m")
    above.legend(fontsize=8, ncols=2, loc="upper right")
    known = [s.deviations for s in statuses if s.deviations is not None and s.deviations.glide_path is not None]
    t = np.array([d.t_s for d in known]) - down.touchdown_s
    paths = [d.glide_path.above for d in known if d.glide_path is not None]
    value, sigma = np.array([p.value for p in paths]), np.array([p.sigma for p in paths])
    beneath.fill_between(t, value - 2.0 * sigma, value + 2.0 * sigma, color="#9ecae1", label="± 2 sigma")
    beneath.plot(t, value, color="#08519c", label="above the glide path")
    beneath.plot(t, [d.right.value for d in known], color="#e6550d", label="right of the centre line")
    beneath.axhline(0.0, color="0.6", linewidth=0.8)
    beneath.set_xlabel("time from the touchdown, s")
    beneath.set_ylabel("m")
    beneath.set_ylim(-4.0, 4.0)
    beneath.legend(fontsize=8, loc="upper left", ncols=3)
    # no version of a program in the file, so that the same flight gives the same picture
    figure.savefig(path, dpi=110, metadata={"Software": None})


def main() -> None:
    """Write the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path, metavar="OUT.png")
    parser.add_argument("--seed", type=int, default=3)
    options = parser.parse_args()
    draw(track(prior_landing(options.seed), options.seed), options.out)
    print(f"wrote {options.out}")


if __name__ == "__main__":
    main()
