"""An alt-azimuth mount behind ASCOM Alpaca as a pan-tilt unit."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from ptu_drivers.alpaca.codec import angles_of, rates_of
from ptu_drivers.alpaca.http_connection import LEAST_S, HttpConnection
from ptu_drivers.alpaca.telescope import AlpacaTelescope, HttpLine
from ptu_drivers.axis_limits import narrowed
from ptu_drivers.errors import ProtocolError, PtuError, RefusedError
from ptu_drivers.exchange_failed import ExchangeFailed
from ptu_drivers.health import FailureReason, HealthCounter
from ptu_drivers.interface import PanTiltUnit
from ptu_drivers.lease import MOVES_ONLY, NO_LEASE
from ptu_drivers.messages import AngleSample, AngleSource, Axis, Capability, Reading, UnitDescription
from ptu_drivers.polled_unit import PolledUnit
from ptu_drivers.protocol_options import parse_options
from ptu_drivers.settings import UnitSettings

_ALT_AZ = 0
_NUMBER = {Axis.PAN: 0, Axis.TILT: 1}
_QUANTUM_DEG = 1e-4
_PROBE_S = 10.0
# a stop without a reply in this time is followed by the next one
_PROMPT_S = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class AlpacaOptions:
    """What an Alpaca telescope cannot be asked.

    Attributes
    ----------
    device : number of the telescope at the server.
    altitude_low_deg, altitude_high_deg : where it may point.
    quantum_deg : step of the angles that it reports.
    slew_rate_deg_s : fastest that it slews.
    update_s : it renews its angles only so often; a reading is half as old on average.
    """

    device: int = 0
    altitude_low_deg: float = 0.0
    altitude_high_deg: float = 90.0
    quantum_deg: float = _QUANTUM_DEG
    slew_rate_deg_s: float = 20.0
    update_s: float = 0.0

    def __post_init__(self) -> None:
        for name, good, wanted in (
            ("device", self.device >= 0, "0 or more"),
            ("altitude_low_deg", -90 <= self.altitude_low_deg < self.altitude_high_deg, "at least -90, below high"),
            ("altitude_high_deg", self.altitude_high_deg <= 90, "at most 90"),
            ("quantum_deg", self.quantum_deg > 0, "above 0"),
            ("slew_rate_deg_s", self.slew_rate_deg_s > 0, "above 0"),
            ("update_s", self.update_s >= 0, "0 or more"),
        ):
            if not good:
                raise ProtocolError(f"Alpaca option {name}", got=repr(getattr(self, name)), wanted=wanted)


class AlpacaUnit(PolledUnit):
    """A mount, probed; made by `open_alpaca` or `connect_alpaca`.

    Azimuth grows clockwise from north: the unit's own pan is minus the azimuth, and north is its zero; `AxisSettings`
    turn that into the runway's. It is unwrapped about the direction that the settings call zero.
    """

    def __init__(
        self,
        telescope: AlpacaTelescope,
        settings: UnitSettings,
        options: AlpacaOptions,
        description: UnitDescription,
        *,
        combined: bool,
        watch: bool,
    ) -> None:
        super().__init__(telescope.line, settings, description, HealthCounter(), watch=watch)
        self._telescope = telescope
        self._options = options
        self._combined = combined
        self._goal: dict[Axis, float] = {}

    def _query(self) -> Reading:
        sent_s = self._line.now()
        until_s = self._until_s
        angles: dict[Axis, float] = {}
        spans: dict[Axis, tuple[float, float]] = {}
        try:
            if self._combined:
                values = combined_state(self._telescope, until_s)
                angles = {Axis.PAN: values["Azimuth"], Axis.TILT: values["Altitude"]}
                spans = dict.fromkeys(Axis, (sent_s, self._line.now()))
            else:
                for axis, name in ((Axis.PAN, "azimuth"), (Axis.TILT, "altitude")):
                    asked_s = self._line.now()
                    angles[axis] = self._telescope.number(name, until_s)
                    spans[axis] = (asked_s, self._line.now())
        except RefusedError as refused:
            raise ExchangeFailed(FailureReason.REFUSED, str(refused)) from refused
        self._health.exchanges = self._telescope.sent
        if not (0 <= angles[Axis.PAN] <= 360 and -90 <= angles[Axis.TILT] <= 90):
            raise ExchangeFailed(FailureReason.OUT_OF_RANGE, f"{angles[Axis.PAN]}, {angles[Axis.TILT]} deg")
        samples = {axis: self._sample(axis, angles[axis], *spans[axis]) for axis in Axis}
        return Reading(pan=samples[Axis.PAN], tilt=samples[Axis.TILT], sent_s=sent_s, answered_s=self._line.now())

    def _sample(self, axis: Axis, value_deg: float, asked_s: float, answered_s: float) -> AngleSample:
        old_s = self._options.update_s
        unit_rad = math.radians(value_deg)
        if axis is Axis.PAN:
            unit_rad = self._about_zero(-unit_rad)
        return AngleSample(
            axis=axis,
            t_s=0.5 * (asked_s + answered_s) - 0.5 * old_s,
            sigma_t_s=math.hypot(answered_s - asked_s, old_s) / math.sqrt(12),
            angle_rad=self._axis(axis).angle(unit_rad),
            sigma_rad=self._description.axis(axis).quantum_rad / math.sqrt(12),
            source=AngleSource.ROUND_TRIP,
        )

    def _about_zero(self, unit_rad: float) -> float:
        """Return the same direction, less than half a turn from where the settings have their zero."""
        zero_rad = self._axis(Axis.PAN).unit_angle(0.0)
        return zero_rad + math.remainder(unit_rad - zero_rad, 2 * math.pi)

    def _set_up(self) -> None:
        prepare(self._telescope, self._until_s)

    def _send_position(self, targets: dict[Axis, float], rate_rad_s: float | None) -> None:
        if len(targets) < len(Axis):
            # the mount takes both at once: the other axis keeps its goal, or stays where it is
            if not self._goal:
                here = self._query()
                self._goal = {a: self._axis(a).unit_angle(here.axis(a).angle_rad) for a in Axis}
            targets = {**self._goal, **targets}
        self._goal = targets
        self._telescope.put(
            "slewtoaltazasync",
            self._until_s,
            Azimuth=f"{-math.degrees(targets[Axis.PAN]) % 360:.6f}",
            Altitude=f"{math.degrees(targets[Axis.TILT]):.6f}",
        )

    def _send_rates(self, rates: dict[Axis, float]) -> None:
        self._goal = {}
        signs = {Axis.PAN: -1, Axis.TILT: 1}
        for axis, rate in rates.items():
            self._move_axis(axis, signs[axis] * math.degrees(rate), self._until_s)

    def _send_halt(self) -> None:
        self._goal = {}
        # what stops a slew need not stop a motion by rate: both are stopped
        stops: list[Callable[[float], None]] = [lambda until_s: self._telescope.put("abortslew", until_s)]
        if Capability.VELOCITY in self._description.capabilities:
            stops[:0] = [partial(self._move_axis, axis, 0.0) for axis in Axis]
        # first all of them without pauses, with or without replies; then each with its share of the time
        faults: list[ExchangeFailed | PtuError] = []
        for most_s in (_PROMPT_S, math.inf):
            faults.clear()
            for sent, stop in enumerate(stops):
                left_s = max(0.0, self._until_s - self._line.now())
                try:
                    stop(self._line.now() + min(most_s, left_s / (len(stops) - sent)))
                except (ExchangeFailed, PtuError) as fault:
                    faults.append(fault)
            if not faults:
                return
        raise faults[0]

    def _move_axis(self, axis: Axis, rate_deg_s: float, until_s: float) -> None:
        self._telescope.put("moveaxis", until_s, Axis=_NUMBER[axis], Rate=f"{rate_deg_s:.6f}")


def connect_alpaca(line: HttpLine, settings: UnitSettings, options: AlpacaOptions, *, watch: bool = True) -> AlpacaUnit:
    """Probe the mount on a line that is open, and return it ready; arguments as `open_alpaca`."""
    telescope = AlpacaTelescope(line, options.device)
    until_s = line.now() + _PROBE_S
    try:
        prepare(telescope, until_s)
        if not telescope.flag("canslewaltazasync", until_s):
            raise ProtocolError(line.url, got="a mount without SlewToAltAzAsync", wanted="one that slews by altitude")
        description = _description(telescope, settings, options, until_s)
        unit = AlpacaUnit(
            telescope, settings, options, description, combined=_has_state(telescope, until_s), watch=watch
        )
    except ExchangeFailed as fault:
        line.close()
        raise ProtocolError(line.url, got=str(fault), wanted="an Alpaca telescope") from fault
    except PtuError as fault:
        line.close()
        if not isinstance(fault, RefusedError):
            raise
        raise ProtocolError(line.url, got=str(fault), wanted=f"telescope {options.device} to answer") from fault
    return unit


def open_alpaca(
    url: str, settings: UnitSettings, clock: Callable[[], float] = time.monotonic, **options: Any
) -> PanTiltUnit:
    """Open a mount at `http://host:port`; `options` are the fields of `AlpacaOptions`."""
    chosen = parse_options(AlpacaOptions, "Alpaca", options)
    line = HttpConnection(url, clock)
    line.reopen()
    return connect_alpaca(line, settings, chosen)


def prepare(telescope: AlpacaTelescope, until_s: float) -> None:
    """Connect and unpark the mount, and turn tracking off. Raises ExchangeFailed, RefusedError, LineError."""
    if not telescope.flag("connected", until_s):
        telescope.put("connected", until_s, Connected=True)
    if telescope.flag("atpark", until_s):
        telescope.put("unpark", until_s)
    if telescope.flag("tracking", until_s):
        telescope.put("tracking", until_s, Tracking=False)


def combined_state(telescope: AlpacaTelescope, until_s: float) -> dict[str, float]:
    """Return azimuth and altitude of one request, deg. Raises ExchangeFailed, RefusedError, LineError."""
    return angles_of(telescope.get("devicestate", until_s))


def _has_state(telescope: AlpacaTelescope, until_s: float) -> bool:
    """Return whether one request gives both angles (interface version 4); mounts support it or refuse it."""
    try:
        combined_state(telescope, until_s)
    except (ExchangeFailed, RefusedError):
        return False
    return True


def _rates_deg_s(telescope: AlpacaTelescope, axis: Axis, until_s: float) -> tuple[float, float] | None:
    """Return the least and greatest rate that an axis takes, deg/s, or None where it cannot turn at one."""
    if not telescope.flag("canmoveaxis", until_s, Axis=_NUMBER[axis]):
        return None
    return rates_of(telescope.get("axisrates", until_s, Axis=_NUMBER[axis]))


def _description(
    telescope: AlpacaTelescope, settings: UnitSettings, options: AlpacaOptions, until_s: float
) -> UnitDescription:
    alignment = telescope.number("alignmentmode", until_s)
    capabilities = {Capability.POSITION}
    # on an equatorial mount the same call turns about the pole
    rates = {axis: _rates_deg_s(telescope, axis, until_s) for axis in Axis} if alignment == _ALT_AZ else {}
    if len(rates) == len(Axis) and all(rates.values()):
        capabilities.add(Capability.VELOCITY)
    half = 180.0 - options.quantum_deg
    zero_deg = math.degrees(settings.pan.unit_angle(0.0))
    axes = {}
    for axis, low_deg, high_deg, origin in (
        (Axis.PAN, zero_deg - half, zero_deg + half, "unit"),
        (Axis.TILT, options.altitude_low_deg, options.altitude_high_deg, "settings"),
    ):
        low_rate, high_rate = rates.get(axis) or (0.0, options.slew_rate_deg_s)
        axes[axis] = narrowed(
            settings.pan if axis is Axis.PAN else settings.tilt,
            quantum_rad=math.radians(options.quantum_deg),
            low_rad=math.radians(low_deg),
            high_rad=math.radians(high_deg),
            max_rate_rad_s=math.radians(high_rate),
            min_rate_rad_s=math.radians(low_rate),
            limits_from=origin,
            rates_from="unit" if rates.get(axis) else "settings",
        )
    return UnitDescription(
        protocol="alpaca",
        url=telescope.line.url,
        model=str(telescope.get("name", until_s)),
        firmware=str(telescope.get("driverversion", until_s)),
        serial="",
        pan=axes[Axis.PAN],
        tilt=axes[Axis.TILT],
        capabilities=frozenset(capabilities),
        # a question may end, a command and a halt of three may begin when the time is over
        reply_timeout_s=2 * settings.reply_timeout_s + 5 * LEAST_S,
        lease=NO_LEASE if Capability.VELOCITY in capabilities else MOVES_ONLY,
        details={"device": str(options.device), "alignment": "alt-az" if alignment == _ALT_AZ else "equatorial"},
    )
