"""Fault campaign for Pelco and Dynamixel units in virtual time, and rubbish into their decoders.

Each run turns a simulated unit to and fro while several faults fall upon the line. Counted: angles outside what their
own stamp and quantum allow, the longest call, and the time from the end of a fault to the next angle.

    python benchmarks/ptu_serial_faults.py [RUNS [STRINGS [pelco|dynamixel]]]
"""

import math
import random
import sys
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from ptu_drivers.dynamixel.codec import PacketDecoder
from ptu_drivers.dynamixel.codec import encode as encode_packet
from ptu_drivers.dynamixel.unit import DynamixelOptions, connect_dynamixel
from ptu_drivers.errors import PtuError
from ptu_drivers.interface import PanTiltUnit
from ptu_drivers.messages import AngleSample, Axis, Reading
from ptu_drivers.pelco.codec import PelcoDecoder, PelcoFraming, encode
from ptu_drivers.pelco.unit import PelcoOptions, connect_pelco
from ptu_drivers.settings import UnitSettings
from ptu_drivers.simulated.dynamixel import SimulatedDynamixel
from ptu_drivers.simulated.line import VirtualLine
from ptu_drivers.simulated.pelco import PelcoModel, SimulatedPelco

_FAULTS_EACH = 6
_SPACING_S = 2.5
RECOVERY_S = 2.0


@dataclass(slots=True)
class FaultCampaignCounts:
    """Counts over the runs of the campaign."""

    runs: int = 0
    faults: Counter[str] = field(default_factory=Counter)
    angles: int = 0
    wrong: int = 0
    slow: int = 0
    longest_call_s: float = 0.0
    too_long: int = 0
    recovery_s: list[float] = field(default_factory=list)
    not_back: int = 0
    failures: Counter[str] = field(default_factory=Counter)
    still_moving: int = 0


@dataclass(slots=True)
class SimulatedLink:
    """A unit and the simulated device at the other end of its line."""

    unit: PanTiltUnit
    sim: Any
    line: Any
    rate_rad_s: float


class SpoiltPelco(SimulatedPelco):
    """A unit whose replies can be corrupted in ways that pass their checksum."""

    def __init__(self, model: PelcoModel, seed: int) -> None:
        super().__init__(model, seed)
        self.spoil: list[Callable[[bytes], bytes]] = []

    def _answer(self, t_s: float, data: bytes, not_before_s: float = 0.0) -> float:
        return super()._answer(t_s, self.spoil.pop()(data) if self.spoil else data, not_before_s)


def pelco(seed: int) -> SimulatedLink:
    """Return a Pelco unit, framing, echo and speed by the seed."""
    draw = random.Random(seed)
    model = PelcoModel(
        framing=draw.choice(tuple(PelcoFraming)),
        baud=draw.choice((4800, 9600, 19200)),
        echo=draw.random() < 0.3,
        acknowledges=False,
        homing_s=draw.uniform(0.0, 5.0),
    )
    sim = SpoiltPelco(model, seed=seed)
    line = VirtualLine(sim, model.baud, seed=seed)
    options = PelcoOptions(max_rate_deg_s=60.0, max_acceleration_deg_s2=120.0)
    unit = connect_pelco(line, UnitSettings(), options, model.framing, watch=False)
    return SimulatedLink(unit, sim, line, math.radians(60.0))


def dynamixel(seed: int) -> SimulatedLink:
    """Return a pair of servos, echo and speed by the seed."""
    draw = random.Random(seed)
    sim = SimulatedDynamixel(baud=draw.choice((57600, 115200)), echo=draw.random() < 0.3, seed=seed)
    line = VirtualLine(sim, sim.baud, seed=seed)
    unit = connect_dynamixel(line, UnitSettings(), DynamixelOptions(), watch=False)
    return SimulatedLink(unit, sim, line, unit.describe().pan.max_rate_rad_s)


def one_run(
    make: Callable[[int], SimulatedLink], seed: int, tally: FaultCampaignCounts, faults: "Faults | None" = None
) -> None:
    """Turn a unit to and fro under faults, of the serial line by default, and count."""
    faults = FAULTS if faults is None else faults
    draw = random.Random(f"faults {seed}")
    bench = make(seed)
    line, unit = bench.line, bench.unit
    tally.runs += 1
    fault_over_s: float | None = None
    next_fault_s = line.now() + draw.uniform(0.3, 1.0)
    next_move_s = line.now()
    left = _FAULTS_EACH
    while left or fault_over_s is not None or line.now() < next_fault_s:
        if left and line.now() >= next_fault_s:
            name = draw.choice(tuple(faults))
            # one fault may fall into another
            fault_over_s = max(fault_over_s or 0.0, line.now() + faults[name](bench, draw))
            tally.faults[name] += 1
            left -= 1
            next_fault_s = line.now() + draw.uniform(0.02, _SPACING_S)
        if line.now() >= next_move_s:
            next_move_s = line.now() + draw.uniform(0.2, 1.0)
            _timed(bench, tally, lambda: _move(bench, draw))
        got = _timed(bench, tally, unit.read)
        if isinstance(got, Reading):
            tally.angles += 2
            tally.wrong += sum(_is_wrong(bench, sample) for sample in (got.pan, got.tilt))
            if fault_over_s is not None and line.now() > fault_over_s:
                tally.recovery_s.append(got.answered_s - fault_over_s)
                tally.slow += tally.recovery_s[-1] > RECOVERY_S
                fault_over_s = None
        elif fault_over_s is not None and line.now() > fault_over_s + 20.0:
            tally.not_back += 1
            break
        line.wait(0.005)
    tally.failures.update({str(reason.value): n for reason, n in unit.health().failures.items()})
    unit.close()
    line.settle(2.0)
    resting = {axis: bench.sim.head_rad(axis, line.now()) for axis in Axis}
    line.settle(0.5)
    tally.still_moving += any(bench.sim.head_rad(axis, line.now()) != resting[axis] for axis in Axis)


def _move(bench: SimulatedLink, draw: random.Random) -> None:
    try:
        bench.unit.move_to(pan_rad=draw.uniform(-1.4, 1.4), tilt_rad=draw.uniform(-1.4, 1.4))
    except PtuError:
        return


def _timed(bench: SimulatedLink, tally: FaultCampaignCounts, call: Callable[[], object]) -> object:
    began = bench.line.now()
    result = call()
    took_s = bench.line.now() - began
    tally.longest_call_s = max(tally.longest_call_s, took_s)
    # a command whose halt is owed may first halt: that has three exchanges
    tally.too_long += took_s > bench.unit.describe().reply_timeout_s + 0.02
    return result


def _is_wrong(bench: SimulatedLink, s: AngleSample) -> bool:
    """The angle was not true at any instant within 3 sigma of its stamp, to 3 sigma of its quantum."""
    n = 24
    if abs(math.remainder(s.angle_rad - bench.sim.head_rad(s.axis, s.t_s), 2 * math.pi)) <= 3 * s.sigma_rad:
        return False
    steps = [s.t_s + 3 * s.sigma_t_s * (i / n - 1) for i in range(2 * n + 1)]
    errors = [math.remainder(s.angle_rad - bench.sim.head_rad(s.axis, t_s), 2 * math.pi) for t_s in steps]
    between = bench.rate_rad_s * 3 * s.sigma_t_s / n
    return min(abs(e) for e in errors) > 3 * s.sigma_rad + between


def _lost_byte(bench: SimulatedLink, draw: random.Random) -> float:
    bench.line.faults.skip, bench.line.faults.lose = draw.randrange(20), draw.randint(1, 3)
    return 0.1


def _lost_in_question(bench: SimulatedLink, draw: random.Random) -> float:
    bench.line.faults.to_unit_lose = draw.randint(1, 5)
    return 0.1


def _wrong_bytes(bench: SimulatedLink, draw: random.Random) -> float:
    bench.line.faults.skip, bench.line.faults.garble = draw.randrange(20), draw.randint(1, 4)
    return 0.1


def _garbage(bench: SimulatedLink, draw: random.Random) -> float:
    length = draw.randint(1, 30)
    data = bytes(draw.choice((0xFF, 0xFD, 0xA0, 0x01, draw.randrange(256))) for _ in range(length))
    bench.sim.say(bench.line.now() + draw.uniform(0.0, 0.05), data)
    return 0.1


def _late(bench: SimulatedLink, draw: random.Random) -> float:
    late_s = draw.uniform(0.02, 0.45)
    bench.sim.late_s.append(late_s)
    return late_s


def _old_answer(bench: SimulatedLink, draw: random.Random) -> float:
    """A reply of the last seconds once more, as from a buffer in between."""
    if not bench.line.traffic:
        bench.line.record = True
    heard = [data for _, way, data in bench.line.traffic if way == "<"]
    if heard:
        bench.sim.say(bench.line.now() + draw.uniform(0.0, 0.05), b"".join(heard[-30:])[-draw.randint(7, 60) :])
    return 0.1


def _two_that_agree(bench: SimulatedLink, draw: random.Random) -> float:
    """Two wrong bytes that agree with the checksum; servos have a CRC, which gets two wrong bytes as they come."""
    if not isinstance(bench.sim, SpoiltPelco):
        return _wrong_bytes(bench, draw)
    k, exclusive = draw.randrange(1, 256), bench.sim.model.framing is PelcoFraming.P

    def spoil(frame: bytes) -> bytes:
        pair = (frame[4] ^ k, frame[5] ^ k) if exclusive else ((frame[4] + k) & 0xFF, (frame[5] - k) & 0xFF)
        return frame[:4] + bytes(pair) + frame[6:]

    bench.sim.spoil.append(spoil)
    return 0.1


def _one_too_many(bench: SimulatedLink, draw: random.Random) -> float:
    """A byte inside a reply, with which its first seven bytes pass the checksum (Pelco-D)."""
    if not isinstance(bench.sim, SpoiltPelco) or bench.sim.model.framing is PelcoFraming.P:
        return _lost_byte(bench, draw)
    bench.sim.spoil.append(lambda f: f[:5] + bytes(((f[5] - sum(f[1:5])) & 0xFF,)) + f[5:])
    return 0.1


def _echo(bench: SimulatedLink, draw: random.Random) -> float:
    bench.sim.echo = not bench.sim.echo
    return 0.0


def _dead(bench: SimulatedLink, draw: random.Random) -> float:
    off_s = draw.uniform(0.05, 3.0)
    bench.line.dead = True
    bench.line.at(bench.line.now() + off_s, lambda: setattr(bench.line, "dead", False))
    return off_s


def _unplugged(bench: SimulatedLink, draw: random.Random) -> float:
    off_s = draw.uniform(0.05, 3.0)
    bench.line.gone = True
    bench.line.at(bench.line.now() + off_s, lambda: setattr(bench.line, "gone", False))
    return off_s


def _power_cycle(bench: SimulatedLink, draw: random.Random) -> float:
    off_s = draw.uniform(0.05, 2.0)
    bench.sim.power_cycle(bench.line.now(), off_s)
    return off_s + (bench.sim.model.homing_s if isinstance(bench.sim, SimulatedPelco) else 0.0)


Faults = dict[str, Callable[[SimulatedLink, random.Random], float]]
FAULTS: Faults = {
    "lost bytes": _lost_byte,
    "lost bytes of a question": _lost_in_question,
    "wrong bytes": _wrong_bytes,
    "wrong bytes that agree": _two_that_agree,
    "a byte too many": _one_too_many,
    "garbage": _garbage,
    "late answer": _late,
    "old answer again": _old_answer,
    "echo on or off": _echo,
    "dead line": _dead,
    "unplugged": _unplugged,
    "power-cycle": _power_cycle,
}
MAKERS: dict[str, Callable[[int], SimulatedLink]] = {"pelco": pelco, "dynamixel": dynamixel}


def report(name: str, t: FaultCampaignCounts) -> bool:
    """Print the result; return whether a guarantee was broken."""
    back = sorted(t.recovery_s)
    print(f"{name}: {t.runs} runs, {sum(t.faults.values())} faults, {t.angles} angles")
    print(f"  faults: {dict(t.faults.most_common())}")
    print(f"  discarded: {dict(t.failures.most_common())}")
    print(f"  wrong angles {t.wrong}; moving after close {t.still_moving}")
    print(f"  longest call {t.longest_call_s:.3f} s; calls beyond the stated time {t.too_long}")
    print(
        f"  back after the fault: median {back[len(back) // 2]:.3f} s, 99 % {back[int(0.99 * len(back))]:.2f} s, "
        f"longest {back[-1]:.2f} s; later than {RECOVERY_S} s {t.slow}, never {t.not_back}"
    )
    return bool(t.wrong or t.slow or t.not_back or t.too_long or t.still_moving)


def campaign(name: str, runs: int, first_seed: int = 0) -> FaultCampaignCounts:
    """Run a unit's part of the campaign."""
    tally = FaultCampaignCounts()
    for seed in range(first_seed, first_seed + runs):
        one_run(MAKERS[name], seed, tally)
    return tally


def fuzz(strings: int, seed: int = 1) -> Counter[str]:
    """Feed random strings to decoders, new ones and continued ones; return the number of messages."""
    draw = random.Random(seed)
    found: Counter[str] = Counter()
    likely = (0xFF, 0xFF, 0xFD, 0x00, 0xA0, 0xAF, 0x01, 0x59, 0x55)
    lasting: tuple[Any, ...] = (PelcoDecoder(), PelcoDecoder(PelcoFraming.P), PacketDecoder())
    for _ in range(strings):
        data = bytes(draw.choice(likely) if draw.random() < 0.7 else draw.randrange(256) for _ in range(12))
        fresh: tuple[Any, ...] = (PelcoDecoder(), PelcoDecoder(PelcoFraming.P), PacketDecoder())
        for old, new in zip(lasting, fresh, strict=True):
            for decoder in (old, new):
                for message in decoder.feed(data):
                    if isinstance(decoder, PelcoDecoder):
                        encode(message, decoder.framing)
                    else:
                        encode_packet(message)
                    found[type(decoder).__name__] += 1
    return found


def main() -> None:
    """Run both campaigns and the fuzzing, and print the figures."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    strings = int(sys.argv[2]) if len(sys.argv) > 2 else 1_000_000
    bad = False
    for name in sys.argv[3:] or MAKERS:
        began = time.perf_counter()
        bad |= report(name, campaign(name, runs))
        print(f"  {time.perf_counter() - began:.0f} s of computing")
    found = fuzz(strings)
    print(f"decoders: {strings} random strings of 12 bytes, messages found by chance {dict(found)}, no exception")
    sys.exit(1 if bad else 0)


if __name__ == "__main__":
    main()
