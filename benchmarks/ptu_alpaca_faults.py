"""Fault campaign for the Alpaca driver in virtual time: six faults in each run, counted as in ptu_serial_faults.py.

Single wrong digits are not among the faults: TCP has a checksum, and nothing in the answers themselves would show them.

    python benchmarks/ptu_alpaca_faults.py [RUNS [FIRST_SEED]]
"""

import json
import math
import random
import sys
from collections.abc import Callable

from ptu_serial_faults import FaultCampaignCounts, Faults, SimulatedLink, one_run, report

from ptu_drivers.alpaca.unit import AlpacaOptions, connect_alpaca
from ptu_drivers.exchange_failed import ExchangeFailed
from ptu_drivers.health import FailureReason
from ptu_drivers.messages import Axis
from ptu_drivers.settings import UnitSettings
from ptu_drivers.simulated.alpaca import MountModel, SimulatedMount
from ptu_drivers.simulated.http_server import VirtualHttp

_RATE_DEG_S = 20.0


class Mount(SimulatedMount):
    """A mount whose truth is asked as of the other units."""

    def head_rad(self, axis: Axis, t_s: float) -> float:
        """Return where an axis is, rad, pan counter-clockwise."""
        return math.radians(self.altitude_deg(t_s) if axis is Axis.TILT else -self.azimuth_deg(t_s))


class FaultyHttp(VirtualHttp):
    """A connection with faults that end by themselves."""

    def __init__(self, mount: SimulatedMount, seed: int) -> None:
        super().__init__(mount, seed)
        self.dead_until_s = self.gone_until_s = 0.0
        self.late_s: list[float] = []
        self.spoil: list[Callable[[int, bytes], tuple[int, bytes]]] = []
        self.reported: list[bytes] = []

    def settle(self, duration_s: float) -> None:
        """Let time pass."""
        self.wait(duration_s)

    def transfer(self, method: str, path: str, query: str, until_s: float) -> tuple[int, bytes]:
        """Return status and body, as the faults leave them."""
        self.dead, self.gone = self.now() < self.dead_until_s, self.now() < self.gone_until_s
        status, body = super().transfer(method, path, query, until_s)
        if self.late_s:
            self.wait(min(self.late_s.pop(), until_s - self.now()))
            if self.now() >= until_s:
                # its connection is closed by then: it has nowhere to arrive
                raise ExchangeFailed(FailureReason.TIMEOUT, f"no answer to {path}")
        self.reported.append(body)
        return self.spoil.pop()(status, body) if self.spoil else (status, body)


def alpaca(seed: int) -> SimulatedLink:
    """Return a mount, its interface version by the seed."""
    draw = random.Random(seed)
    mount = Mount(MountModel(state=draw.random() < 0.5, max_rate_deg_s=_RATE_DEG_S))
    line = FaultyHttp(mount, seed)
    unit = connect_alpaca(line, UnitSettings(), AlpacaOptions(altitude_low_deg=-10.0), watch=False)
    return SimulatedLink(unit, mount, line, math.radians(_RATE_DEG_S))


def _dead(bench: SimulatedLink, draw: random.Random) -> float:
    off_s = draw.uniform(0.05, 3.0)
    bench.line.dead_until_s = bench.line.now() + off_s
    return off_s


def _refused(bench: SimulatedLink, draw: random.Random) -> float:
    off_s = draw.uniform(0.05, 3.0)
    bench.line.gone_until_s = bench.line.now() + off_s
    return off_s


def _restart(bench: SimulatedLink, draw: random.Random) -> float:
    """The server ends and returns: parked, unconnected, where it was."""
    off_s = _refused(bench, draw)
    mount = bench.sim
    mount.connected, mount.parked, mount.tracking = False, True, True
    for axis in mount.axes.values():
        axis.halt(bench.line.now())
    return off_s


def _late(bench: SimulatedLink, draw: random.Random) -> float:
    late_s = draw.uniform(0.02, 1.0)
    bench.line.late_s.append(late_s)
    return late_s


def _spoilt(
    how: Callable[[random.Random, int, bytes], tuple[int, bytes]],
) -> Callable[[SimulatedLink, random.Random], float]:
    def fault(bench: SimulatedLink, draw: random.Random) -> float:
        for _ in range(draw.randint(1, 3)):
            bench.line.spoil.append(lambda status, body: how(draw, status, body))
        return 0.1

    return fault


def _old(bench: SimulatedLink, draw: random.Random) -> float:
    """A reply to an older request, complete."""
    bench.line.spoil.append(lambda status, _body: (status, draw.choice(bench.line.reported[-30:-1])))
    return 0.1


def _odd(draw: random.Random, status: int, body: bytes) -> tuple[int, bytes]:
    odd = draw.choice((None, True, "12.5", [], {}, 10**400, float("nan"), 1e9, [{"Name": []}]))
    return status, json.dumps(json.loads(body) | {"Value": odd}).encode()


def _error(draw: random.Random, status: int, body: bytes) -> tuple[int, bytes]:
    number = draw.choice((0x407, 0x40B, 0x500))
    return status, json.dumps(json.loads(body) | {"ErrorNumber": number, "ErrorMessage": "oops"}).encode()


FAULTS: Faults = {
    "no answer": _dead,
    "connection refused": _refused,
    "server restarted": _restart,
    "late answer": _late,
    "old answer again": _old,
    "truncated": _spoilt(lambda draw, status, body: (status, body[: draw.randrange(len(body))])),
    "garbage": _spoilt(lambda draw, status, _body: (status, draw.randbytes(draw.randrange(80)))),
    "odd value": _spoilt(_odd),
    "device error": _spoilt(_error),
    "HTTP error": _spoilt(lambda draw, _status, _body: (draw.choice((400, 404, 500, 503)), b"oops")),
}


def campaign(runs: int, first_seed: int = 0) -> FaultCampaignCounts:
    """Run it."""
    tally = FaultCampaignCounts()
    for seed in range(first_seed, first_seed + runs):
        one_run(alpaca, seed, tally, FAULTS)
    return tally


if __name__ == "__main__":
    asked = [int(word) for word in sys.argv[1:]]
    sys.exit(report("alpaca", campaign(*(asked or [1000]))))
