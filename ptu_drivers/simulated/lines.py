"""Lines to simulated units of the protocols without faults of their own, by name, for `groundstation ptu simulate`."""

from ptu_drivers.errors import ProtocolError
from ptu_drivers.pelco.codec import PelcoFraming
from ptu_drivers.simulated.dynamixel import SimulatedDynamixel
from ptu_drivers.simulated.line import VirtualLine
from ptu_drivers.simulated.peer import SimulatedPeer
from ptu_drivers.simulated.pelco import PelcoModel, SimulatedPelco

OTHERS = ("pelco-d", "pelco-p", "dynamixel")


def simulated_line(
    protocol: str, *, start_s: float, network: bool, play_deg: float = 0.0, seed: int = 0
) -> VirtualLine:
    """Return the line to a unit as it leaves the factory: Pelco address 1 at 9600 bit/s, servos 1 and 2 at 57600.

    Parameters
    ----------
    protocol : one of `OTHERS`.
    start_s : the line's first instant, s.
    network : a line without character times.
    play_deg : backlash of a Pelco unit, deg.
    seed : of its latencies.
    """
    unit: SimulatedPeer
    if protocol == "dynamixel":
        unit = SimulatedDynamixel(baud=0 if network else 57600, seed=seed)
    elif protocol in OTHERS:
        framing = PelcoFraming.D if protocol == "pelco-d" else PelcoFraming.P
        unit = SimulatedPelco(PelcoModel(framing=framing, baud=0 if network else 9600, play_deg=play_deg), seed=seed)
    else:
        raise ProtocolError("protocol", got=protocol, wanted="one of " + ", ".join(OTHERS))
    return VirtualLine(unit, unit.baud, start_s=start_s, seed=seed)
