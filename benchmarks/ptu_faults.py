"""Fault campaign of the FLIR driver on simulated units in virtual time: is any angle wrong, does anything hang?

Each run is seeded: a unit that is moved about (by position and by rate) at 9600 or 115200 baud or on a network line,
asked in one of three ways, and two to six faults during the motion. An angle counts as wrong if it is off the
simulated truth by more than 2 counts and 5 sigma of its stated instant. Figures in docs/notes/field.md.
"""

import argparse
import collections
import random
import sys
from dataclasses import dataclass, field

from ptu_drivers import Axis, NoReading, PanTiltUnit, PtuError, Reading, UnitSettings
from ptu_drivers.flir.setup import connect
from ptu_drivers.simulated.faults import FAULTS
from ptu_drivers.simulated.flir import FlirModel
from ptu_drivers.simulated.flir_line import LineModel, SimulatedUnit
from ptu_drivers.simulated.line import VirtualLine

SLACK_COUNTS = 2.0
RECOVERY_S = 2.0


@dataclass
class Outcome:
    """Result of a run."""

    seed: int
    faults: list[str] = field(default_factory=list)
    readings: int = 0
    failures: int = 0
    wrong: list[str] = field(default_factory=list)
    worst_counts: float = 0.0
    longest_read_s: float = 0.0
    allowed_read_s: float = 0.0
    recovery_s: float = 0.0
    resyncs: int = 0
    reconnects: int = 0
    restarts: int = 0
    reasons: dict[str, int] = field(default_factory=dict)

    @property
    def failed(self) -> bool:
        """Return whether it broke a promise."""
        return bool(self.wrong) or self.recovery_s > RECOVERY_S or self.longest_read_s > self.allowed_read_s


def make_unit(rnd: random.Random, seed: int) -> tuple[SimulatedUnit, VirtualLine, UnitSettings]:
    how = rnd.randrange(3)
    model = FlirModel(
        combined=how > 0,
        device_clock=how > 1,
        rate=rnd.choice((500, 2000, 6000)),
        homing_s=rnd.uniform(3.0, 40.0),
        arcsec=rnd.choice((22.5, 92.5714)),
    )
    network = rnd.random() < 0.2
    raise_to = 0 if network else rnd.choice((0, 0, 115200))
    line_model = LineModel(baud=0 if network else 9600, leading_lf=rnd.random() < 0.3)
    unit = SimulatedUnit(model, line_model, seed=seed)
    batch_s = rnd.choice((0.0, 0.0, 0.001, 0.016))
    line = VirtualLine(unit, 0 if network else 9600, batch_s=batch_s, send_delay_s=rnd.choice((0.0, 0.001)), seed=seed)
    return unit, line, UnitSettings(baud=raise_to)


def drive(device: PanTiltUnit, rnd: random.Random) -> None:
    """Send a new command; a line in failure may refuse."""
    reported = device.describe()
    try:
        if rnd.random() < 0.75:
            pan = rnd.uniform(0.6 * reported.pan.low_rad, 0.6 * reported.pan.high_rad)
            tilt = rnd.uniform(0.6 * reported.tilt.low_rad, 0.6 * reported.tilt.high_rad)
            device.move_to(pan_rad=pan, tilt_rad=tilt)
        else:
            device.move_at(
                pan_rad_s=rnd.uniform(-0.4, 0.4) * reported.pan.max_rate_rad_s,
                tilt_rad_s=rnd.choice((0.0, 0.1)) * reported.tilt.max_rate_rad_s,
            )
    except PtuError:
        return


def check(unit: SimulatedUnit, device: PanTiltUnit, got: Reading, outcome: Outcome) -> None:
    """Hold a reading against the truth."""
    for s in (got.pan, got.tilt):
        axis = unit.flir.axes["P" if s.axis is Axis.PAN else "T"]
        counts = s.angle_rad / device.describe().axis(s.axis).quantum_rad
        error = abs(counts - (axis.motor(s.t_s) - axis.origin))
        fastest = max(abs(axis.speed(s.t_s + k * s.sigma_t_s)) for k in (-5, 0, 5))
        outcome.worst_counts = max(outcome.worst_counts, error)
        if error > SLACK_COUNTS + fastest * 5 * s.sigma_t_s:
            truth = axis.motor(s.t_s) - axis.origin
            outcome.wrong.append(f"t {s.t_s:.3f} {s.axis} {counts:.1f}, truth {truth:.1f}, sigma_t {s.sigma_t_s:.5f}")


def run(seed: int) -> Outcome:
    """Return the result of one seeded run."""
    rnd = random.Random(seed)
    unit, line, settings = make_unit(rnd, seed)
    outcome = Outcome(seed=seed)
    device = connect(line, settings)
    outcome.allowed_read_s = device.describe().reply_timeout_s + 0.05
    start = line.now()
    well_s = start + 5.0
    ends: list[float] = []

    def strike(name: str) -> None:
        ends.append(line.now() + FAULTS[name](line, rnd))

    for _ in range(rnd.randrange(2, 7)):
        name = rnd.choice(list(FAULTS))
        outcome.faults.append(name)
        line.at(start + rnd.uniform(0.5, 5.0), lambda name=name: strike(name))
    commanded_s, back_s = float("-inf"), None
    while True:
        if line.now() - commanded_s > 0.7:
            commanded_s = line.now()
            drive(device, rnd)
        asked = line.now()
        got = device.read()
        outcome.longest_read_s = max(outcome.longest_read_s, line.now() - asked)
        well_s = max([well_s, unit.late_until_s, *ends])
        moving = any(axis.end_s() > line.now() for axis in unit.flir.axes.values())
        if moving and device.health().restarts and not isinstance(got, Reading):
            # it talked verbosely after a long silence, as a restarted unit does, and is awaited until it stands still
            well_s = max(well_s, line.now())
        if isinstance(got, Reading):
            outcome.readings += 1
            check(unit, device, got, outcome)
            if asked > well_s and back_s is None:
                back_s = line.now()
        elif line.now() == asked:
            assert isinstance(got, NoReading)
            line.wait(0.01)
        if line.now() > well_s + RECOVERY_S + 1.0 and len(ends) == len(outcome.faults):
            break
    outcome.recovery_s = (back_s or float("inf")) - well_s
    health = device.health()
    outcome.failures, outcome.resyncs = sum(health.failures.values()), health.resyncs
    outcome.reconnects, outcome.restarts = health.reconnects, health.restarts
    outcome.reasons = {str(k): v for k, v in health.failures.items()}
    device.close()
    return outcome


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=1500)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    options = parser.parse_args()
    outcomes = [run(seed) for seed in range(options.first, options.first + options.runs)]
    reasons: collections.Counter[str] = collections.Counter()
    for o in outcomes:
        reasons.update(o.reasons)
        if o.failed:
            took = f"recovery {o.recovery_s:.2f} s, read {o.longest_read_s:.2f} s"
            print(f"seed {o.seed}: {o.faults}, {took}, {o.wrong[:3]}")
    back = sorted(o.recovery_s for o in outcomes)
    total = {k: sum(getattr(o, k) for o in outcomes) for k in ("readings", "resyncs", "reconnects", "restarts")}
    struck = collections.Counter(name for o in outcomes for name in o.faults)
    print(f"runs {len(outcomes)}, faults {sum(struck.values())}, runs that failed {sum(o.failed for o in outcomes)}")
    print(f"faults by kind: {dict(struck.most_common())}")
    print(f"angles {2 * total['readings']}, wrong {sum(len(o.wrong) for o in outcomes)}")
    print(f"failures by reason: {dict(reasons.most_common())}")
    print(f"resyncs {total['resyncs']}, reconnects {total['reconnects']}, restarts {total['restarts']}")
    print(
        f"recovery s: median {back[len(back) // 2]:.3f}, 95 % {back[int(0.95 * len(back))]:.3f}, worst {back[-1]:.3f}"
    )
    print(
        f"longest read: {max(o.longest_read_s for o in outcomes):.3f} s, stated and allowed "
        f"{max(o.allowed_read_s for o in outcomes):.3f} s"
    )
    sys.exit(any(o.failed for o in outcomes))


if __name__ == "__main__":
    main()
