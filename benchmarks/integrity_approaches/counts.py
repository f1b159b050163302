"""Jobs of benchmarks/integrity_study.py: counts of many approaches, as JSON has them."""

from typing import Any

import numpy as np

from integrity_approaches.fault_list import SITE
from integrity_approaches.linear_approach import STEP_S, DrawnFaults, LinearApproach, Outcomes
from integrity_approaches.strata import NO_FAULT, approach_of, drawn, shares, strata_of, stratum_of

# shares of the alert limits beyond which an error counts: the limits, and what happens once in a thousand approaches
FULL, BRUTE = 1.0, 0.12
# approaches at a time: what fits into a core's cache is twice as fast
_BLOCK = 2000
# a fault whose separation without noise is twice the threshold is certainly seen
_CERTAIN = 2.0
# sizes of the diagram: errors and levels up to so many alert limits, and its cells
DIAGRAM_LIMITS, DIAGRAM_CELLS = 1.6, 64


def _blocks(n: int) -> list[int]:
    return [min(_BLOCK, n - k) for k in range(0, n, _BLOCK)]


def _part(faults: DrawnFaults, rows: Any) -> DrawnFaults:
    return DrawnFaults(parameters=faults.parameters[rows], begin_s=faults.begin_s[rows], drifting=faults.drifting)


def _unseen(approach: LinearApproach, faults: DrawnFaults, rows: Any) -> int:
    """Return how many of these faults the residuals would not show, were there no noise."""
    count = int(np.count_nonzero(rows))
    if not count:
        return 0
    alone = approach.fly(np.random.default_rng(0), _part(faults, rows), noise=0.0)
    return int(np.count_nonzero(alone.separation < 1.0))


def importance(job: tuple[str, str, int, int, float]) -> dict[str, Any]:
    """Return weighted sums of misleading approaches of one kind: site, kind, number, seed, scale of the sizes."""
    site, name, n, seed, scale = job
    approach, stratum, rng = approach_of(site), stratum_of(site, name), np.random.default_rng([seed, 1])
    found: dict[str, Any] = {"n": n, "unseen": 0}
    sums = {name: np.zeros(3) for name in ("misleading", "brute", "exceeding")}
    for size in _blocks(n):
        sample = drawn(site, stratum, rng, size, scale)
        outcome = approach.fly(rng, sample.faults)
        hits = (outcome.misleading > FULL, outcome.misleading > BRUTE, outcome.exceeding > 1.0)
        for total, hit in zip(sums.values(), hits, strict=True):
            w = sample.weights[hit]
            total += [w.sum(), (w**2).sum(), len(w)]
        found["unseen"] += _unseen(approach, sample.faults, outcome.misleading > FULL)
    return {**found, **{measure: total.tolist() for measure, total in sums.items()}}


def by_nature(job: tuple[str, int, int]) -> dict[str, Any]:
    """Return counts of approaches that are drawn as they come: site, number, seed."""
    site, n, seed = job
    approach, strata, rng = approach_of(site), strata_of(site), np.random.default_rng([seed, 2])
    counts = rng.multinomial(n, shares(strata))
    total = {"n": n, "misleading": 0, "brute": 0, "fault_free": 0, "false_alarms": 0, "false_wave_offs": 0}
    total["exceeding"] = 0
    for stratum, many in zip(strata, counts.tolist(), strict=True):
        for size in _blocks(many):
            outcome = approach.fly(rng, drawn(site, stratum, rng, size).faults)
            total["misleading"] += int(np.count_nonzero(outcome.misleading > FULL))
            total["exceeding"] += int(np.count_nonzero(outcome.exceeding > 1.0))
            total["brute"] += int(np.count_nonzero(outcome.misleading > BRUTE))
            if stratum.name == NO_FAULT:
                total["fault_free"] += size
                total["false_alarms"] += int(np.count_nonzero(outcome.alarmed))
                total["false_wave_offs"] += int(np.count_nonzero(~outcome.go[:, -1]))
    return total


def with_a_fault(job: tuple[str, int, int]) -> dict[str, Any]:
    """Return counts of approaches that each have a fault, by the priors: site, number, seed."""
    site, n, seed = job
    approach, rng = approach_of(site), np.random.default_rng([seed, 3])
    strata = [s for s in strata_of(site) if s.name != NO_FAULT]
    counts = rng.multinomial(n, shares(strata))
    total: dict[str, Any] = {"n": n, "misleading": 0, "unseen": 0, "beyond": 0, "go": 0}
    alert_s: list[float] = []
    for stratum, many in zip(strata, counts.tolist(), strict=True):
        for size in _blocks(many):
            faults = drawn(site, stratum, rng, size).faults
            outcome = approach.fly(rng, faults)
            hit = outcome.misleading > FULL
            total["misleading"] += int(np.count_nonzero(hit))
            total["unseen"] += _unseen(approach, faults, hit)
            total["beyond"] += int(np.count_nonzero(_beyond(approach, outcome)))
            total["go"] += int(np.count_nonzero(outcome.go[:, -1]))
            alert_s += _alert_s(approach, faults, outcome)
    late = np.array(alert_s)
    total["certain"] = len(late)
    total["in_time"] = int(np.count_nonzero(late <= SITE.alert_limits.time_to_alert_s + 1e-6))
    total["slowest_s"] = float(late.max(initial=0.0))
    return total


def _beyond(approach: LinearApproach, outcome: Outcomes) -> Any:
    """Return whether an error exceeds a limit at any time of an approach, whatever the advice is."""
    return (np.abs(outcome.error_m) > approach.limit_m).any(axis=(1, 2))


def _alert_s(approach: LinearApproach, faults: DrawnFaults, outcome: Outcomes) -> list[float]:
    """Return how long after its beginning each sudden fault was called that is certain to be seen half a second on."""
    if faults.drifting:
        return []
    begun = (faults.begin_s > approach.t_s[0]) & (faults.begin_s < approach.t_s[-1] - 1.0)
    if not begun.any():
        return []
    part = _part(faults, begun)
    alone = approach.fly(np.random.default_rng(0), part, noise=0.0)
    # seen all the time from then on, not only when the aircraft is near
    k = np.searchsorted(approach.t_s, part.begin_s + SITE.alert_limits.time_to_alert_s - STEP_S)
    certain = alone.separations[np.arange(len(k)), k] > _CERTAIN
    return np.asarray((outcome.alarm_s[begun] - part.begin_s)[certain]).tolist()


def following(site: str) -> float:
    """Return by how much more than one fix the filter follows a sudden fault at most, half a second after it began.

    Over all faults' directions and beginnings, in shares of the alert limits.
    """
    approach, worst = approach_of(site), 0.0
    begins = np.arange(approach.t_s[0], approach.t_s[-1] - 1.0, 0.5)
    for f in range(len(approach.hypotheses)):
        for direction in range(3):
            parameters = np.zeros((len(begins), len(approach.hypotheses), 3))
            parameters[:, f, direction] = 1.0
            faults = DrawnFaults(parameters=parameters, begin_s=begins)
            outcome = approach.fly(np.random.default_rng(0), faults, noise=0.0)
            fixes = np.array([fix[:, f, direction] for fix in approach.fixes])
            fix = (np.abs(fixes) / approach.limit_m).max(axis=1)
            moved = (np.abs(outcome.error_m) / approach.limit_m).max(axis=2)
            late = approach.t_s >= begins[:, None] + SITE.alert_limits.time_to_alert_s
            ratio = np.where(late & (fix > 1e-9), moved / np.maximum(fix, 1e-9), 0.0)
            worst = max(worst, float(ratio.max()))
    return worst


def diagram(job: tuple[str, int, int]) -> list[Any]:
    """Return counts (3, cells, cells) of levels and errors in alert limits: site, approaches of each kind, seed.

    Rows are levels; times without an alarm so far, of all kinds of approaches in equal numbers.
    """
    site, n, seed = job
    approach, rng = approach_of(site), np.random.default_rng([seed, 4])
    edges = np.linspace(0.0, DIAGRAM_LIMITS, DIAGRAM_CELLS + 1)
    counts = np.zeros((3, DIAGRAM_CELLS, DIAGRAM_CELLS))
    for stratum in strata_of(site):
        outcome = approach.fly(rng, drawn(site, stratum, rng, n).faults)
        quiet = approach.t_s < outcome.alarm_s[:, None]
        for axis in range(3):
            level = np.broadcast_to(approach.level_m[:, axis] / approach.limit_m[:, axis], quiet.shape)
            error = np.abs(outcome.error_m[..., axis]) / approach.limit_m[:, axis]
            most = DIAGRAM_LIMITS - 1e-9
            counts[axis] += np.histogram2d(
                np.minimum(level[quiet], most), np.minimum(error[quiet], most), bins=(edges, edges)
            )[0]
    return list(counts.tolist())
