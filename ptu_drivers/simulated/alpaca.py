"""A simulated alt-azimuth mount with Alpaca requests: no socket, no clock; one reply per request."""

import json
from dataclasses import dataclass
from urllib.parse import parse_qs

from ptu_drivers.messages import Axis
from ptu_drivers.simulated.axis import SimulatedAxis

_STEPS = 10_000  # counts per degree
_NOT_IMPLEMENTED, _INVALID = 0x400, 0x401


@dataclass(frozen=True, slots=True, kw_only=True)
class MountModel:
    """Properties of the simulated mount.

    Attributes
    ----------
    max_rate_deg_s, acceleration_deg_s2 : of both axes.
    altitude_deg : its range.
    alignment : 0 alt-az, 1 polar, 2 German polar.
    state : supports `devicestate`, as in interface version 4.
    """

    max_rate_deg_s: float = 20.0
    acceleration_deg_s2: float = 60.0
    altitude_deg: tuple[float, float] = (-10.0, 90.0)
    alignment: int = 0
    state: bool = True


class SimulatedMount:
    """The mount; axes count to the east of north and upwards."""

    def __init__(self, model: MountModel | None = None) -> None:
        self.model = model or MountModel()
        low, high = self.model.altitude_deg
        self.axes = {
            Axis.PAN: self._axis(-3600 * _STEPS, 3600 * _STEPS),
            Axis.TILT: self._axis(round(low * _STEPS), round(high * _STEPS)),
        }
        self.connected, self.parked, self.tracking = False, True, True

    def _axis(self, low: int, high: int) -> SimulatedAxis:
        rate = self.model.max_rate_deg_s * _STEPS
        return SimulatedAxis(
            low=low, high=high, rate=rate, max_rate=rate, acceleration=self.model.acceleration_deg_s2 * _STEPS
        )

    def azimuth_deg(self, t_s: float) -> float:
        """Return the azimuth, deg in [0, 360)."""
        return self.axes[Axis.PAN].counter(t_s) / _STEPS % 360

    def altitude_deg(self, t_s: float) -> float:
        """Return the altitude, deg."""
        return self.axes[Axis.TILT].counter(t_s) / _STEPS

    def answer(self, t_s: float, method: str, path: str, query: str) -> tuple[int, bytes]:
        """Return status and body of a request that arrived at `t_s`."""
        given = {key: values[0] for key, values in parse_qs(query).items()}
        head, _, name = path.rpartition("/")
        if head != "/api/v1/telescope/0":
            return 400, b"unknown device"
        body: dict[str, object] = {"ClientTransactionID": int(given.get("ClientTransactionID", 0))}
        try:
            value = None
            if method == "GET":
                value = self._get(t_s, name, given)
            else:
                self._put(t_s, name, given)
        except LookupError as refused:
            number, text = refused.args
            body |= {"ErrorNumber": number, "ErrorMessage": text}
        else:
            body |= {"ErrorNumber": 0, "ErrorMessage": ""}
            if value is not None:
                body["Value"] = value
        return 200, json.dumps(body).encode()

    def _get(self, t_s: float, name: str, given: dict[str, str]) -> object:
        m = self.model
        values: dict[str, object] = {
            "azimuth": self.azimuth_deg(t_s),
            "altitude": self.altitude_deg(t_s),
            "connected": self.connected,
            "atpark": self.parked,
            "tracking": self.tracking,
            "slewing": any(axis.speed(t_s) != 0 for axis in self.axes.values()),
            "alignmentmode": m.alignment,
            "canslewaltazasync": True,
            "canmoveaxis": given.get("Axis") in ("0", "1"),
            "axisrates": [{"Minimum": 0.0, "Maximum": m.max_rate_deg_s}],
            "name": "Simulated mount",
            "driverversion": "1.0",
        }
        if name == "devicestate" and m.state:
            return [{"Name": key.capitalize(), "Value": values[key]} for key in ("altitude", "azimuth", "slewing")]
        if name not in values:
            raise LookupError(_NOT_IMPLEMENTED, f"{name} is not implemented")
        return values[name]

    def _put(self, t_s: float, name: str, given: dict[str, str]) -> None:
        if name in ("connected", "tracking"):
            setattr(self, name, given[name.capitalize()] == "True")
        elif name == "unpark":
            self.parked = False
        elif name == "slewtoaltazasync":
            azimuth, altitude = float(given["Azimuth"]), float(given["Altitude"])
            low, high = self.model.altitude_deg
            if not (0 <= azimuth < 360 and low <= altitude <= high):
                raise LookupError(_INVALID, f"{azimuth}, {altitude} is out of range")
            pan = self.axes[Axis.PAN]
            here = pan.counter(t_s)
            pan.move_to(t_s, here + (round(azimuth * _STEPS) - here + 180 * _STEPS) % (360 * _STEPS) - 180 * _STEPS)
            self.axes[Axis.TILT].move_to(t_s, round(altitude * _STEPS))
        elif name == "moveaxis":
            rate = float(given["Rate"])
            if abs(rate) > self.model.max_rate_deg_s:
                raise LookupError(_INVALID, f"rate {rate} is out of range")
            axis = self.axes[Axis.PAN if given["Axis"] == "0" else Axis.TILT]
            axis.move_at(t_s, rate * _STEPS)
        elif name == "abortslew":
            for axis in self.axes.values():
                axis.halt(t_s)
        else:
            raise LookupError(_NOT_IMPLEMENTED, f"{name} is not implemented")
