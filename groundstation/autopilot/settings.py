"""How an autopilot is reached and what it is sent; the keys of ``[autopilot]`` (docs/autopilot.md)."""

from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path

from groundstation.errors import ConfigError, UsageError
from groundstation.files.toml_table import TomlTable, load_toml

AUTOPILOT_FORMAT = "groundstation-autopilot/1"


class AutopilotMode(StrEnum):
    """Which message carries the position."""

    GPS_INPUT = "gps_input"
    GLOBAL_POSITION = "global_position"
    VISION = "vision"
    ODOMETRY = "odometry"


# ArduPilot takes GPS_INPUT at 5 Hz and more and external navigation up to 50 Hz; PX4 wants vision at 30 to 50 Hz
_RATE_HZ = {
    AutopilotMode.GPS_INPUT: 10.0,
    AutopilotMode.GLOBAL_POSITION: 20.0,
    AutopilotMode.VISION: 40.0,
    AutopilotMode.ODOMETRY: 40.0,
}
# What the vehicle takes the time between a measurement and its arrival for, unless its parameters state it: ArduPilot's
# MAVLink receiver 0.2 s (GPS1_DELAY_MS = 0), external navigation there 10 ms (VISO_DELAY_MS); PX4 nothing.
_ASSUMED_DELAY_S = {
    AutopilotMode.GPS_INPUT: 0.2,
    AutopilotMode.GLOBAL_POSITION: 0.0,
    AutopilotMode.VISION: 0.0,
    AutopilotMode.ODOMETRY: 0.0,
}
# The oldest measurement that the vehicle's filter still takes: ArduPilot's buffers 250 ms; PX4's EKF2 fused vision of
# 180 ms and never of 200 ms
MOST_DELAY_S = {
    AutopilotMode.GPS_INPUT: 0.25,
    AutopilotMode.GLOBAL_POSITION: 0.18,
    AutopilotMode.VISION: 0.18,
    AutopilotMode.ODOMETRY: 0.18,
}
_KEYS = frozenset(
    {
        *("url", "mode", "rate_hz", "delay_s", "link_delay_s", "link_delay_sigma_s", "reference_in_body_m"),
        "geoid_separation_m",
        *("system_id", "component_id", "target_system", "gps_id", "sensor_id", "signing_key", "most_sigma_m"),
    }
)


@dataclass(frozen=True, slots=True, kw_only=True)
class AutopilotSettings:
    """Settings of a stream.

    Attributes
    ----------
    url : ``udpout:HOST:PORT`` (send to), ``udpin:[HOST:]PORT`` (listen at, 127.0.0.1 unless stated), ``tcp:HOST:PORT``,
        or a serial port, ``/dev/ttyUSB0[:BAUD]``.
    mode : the message.
    rate_hz : how often, None for the mode's rate.
    delay_s : what the vehicle assumes to pass between the time of a measurement and its arrival; None takes the
        vehicle's parameter, or the autopilot's default where it does not answer.
    link_delay_s : of the radio, one way; None measures it by TIMESYNC, and takes 0 where nothing answers.
    link_delay_sigma_s : what one message's delay differs by from that, one sigma; None measures it likewise, and takes
        20 ms where nothing answers.
    reference_in_body_m : forward, right, down from the nose to the vehicle's point: of the antenna for ``gps_input``,
        of the IMU otherwise.
    geoid_separation_m : height of the geoid above the ellipsoid; None where the mode, or the session, does not need it.
    system_id, component_id : of this station; ``target_system`` the vehicle's, 0 for the first that is heard.
    gps_id, sensor_id : which of the vehicle's receivers, or EKF2_AGP sensors, it stands for.
    signing_key : file with the key of message signing, None without.
    most_sigma_m : nothing is sent while one sigma, horizontal or vertical, is larger.
    """

    url: str
    mode: AutopilotMode
    rate_hz: float | None = None
    delay_s: float | None = None
    link_delay_s: float | None = None
    link_delay_sigma_s: float | None = None
    reference_in_body_m: tuple[float, float, float] | None = None
    geoid_separation_m: float | None = None
    system_id: int = 245
    component_id: int = 197
    target_system: int = 0
    gps_id: int = 0
    sensor_id: int = 1
    signing_key: Path | None = None
    most_sigma_m: float = 10.0

    def __post_init__(self) -> None:
        most_s = MOST_DELAY_S[self.mode]
        if self.delay_s is not None and not 0.0 <= self.delay_s <= most_s:
            raise ConfigError(
                "delay_s",
                got=f"{self.delay_s:g}",
                wanted=f"0 to {most_s:g} s: the vehicle's filter refuses an older measurement in mode {self.mode}",
            )

    @property
    def period_s(self) -> float:
        """Time between messages, s."""
        return 1.0 / (_RATE_HZ[self.mode] if self.rate_hz is None else self.rate_hz)

    @property
    def assumed_delay_s(self) -> float:
        """``delay_s``, or the autopilot's default, s."""
        return _ASSUMED_DELAY_S[self.mode] if self.delay_s is None else self.delay_s


def load_autopilot(path: Path) -> AutopilotSettings:
    """Read an autopilot file. Raises `ConfigError`."""
    top = TomlTable(load_toml(path, ConfigError), str(path), ConfigError)
    top.choice("format", [AUTOPILOT_FORMAT])
    values = {key: value for key, value in top.values.items() if key != "format"}
    return parse_autopilot(TomlTable(values, str(path), ConfigError), path.parent)


def with_link(file: AutopilotSettings | None, url: str, mode: str | None) -> AutopilotSettings:
    """Return a file's settings, if there are any, with a URL and a mode, None for the file's. Raises `UsageError`."""
    if file is not None:
        return replace(file, url=url, mode=file.mode if mode is None else AutopilotMode(mode))
    if mode is None:
        raise UsageError("mode of the autopilot", got="none", wanted=f"one of {', '.join(AutopilotMode)}, or a file")
    return AutopilotSettings(url=url, mode=AutopilotMode(mode))


def parse_autopilot(table: TomlTable, folder: Path) -> AutopilotSettings:
    """Return the settings of a table; the key's file is relative to ``folder``. Raises `ConfigError`."""
    table.refuse_unknown(_KEYS)
    arm = table.vector("reference_in_body_m", 3) if "reference_in_body_m" in table else None
    if arm is not None and max(abs(float(v)) for v in arm) > 100.0:
        raise table.fail("reference_in_body_m", str(arm), "metres from the nose")
    return AutopilotSettings(
        url=table.text("url"),
        mode=AutopilotMode(table.choice("mode", [str(mode) for mode in AutopilotMode])),
        rate_hz=table.number("rate_hz", minimum=1.0, maximum=50.0) if "rate_hz" in table else None,
        delay_s=table.number("delay_s", minimum=0.0, maximum=1.0) if "delay_s" in table else None,
        link_delay_s=table.number("link_delay_s", minimum=0.0, maximum=1.0) if "link_delay_s" in table else None,
        link_delay_sigma_s=(
            table.number("link_delay_sigma_s", minimum=0.0, maximum=1.0) if "link_delay_sigma_s" in table else None
        ),
        reference_in_body_m=None if arm is None else (float(arm[0]), float(arm[1]), float(arm[2])),
        geoid_separation_m=(
            table.number("geoid_separation_m", minimum=-200.0, maximum=200.0) if "geoid_separation_m" in table else None
        ),
        system_id=_integer(table, "system_id", 245, 1, 255),
        component_id=_integer(table, "component_id", 197, 1, 255),
        target_system=_integer(table, "target_system", 0, 0, 255),
        gps_id=_integer(table, "gps_id", 0, 0, 7),
        sensor_id=_integer(table, "sensor_id", 1, 0, 255),
        signing_key=folder / table.text("signing_key") if "signing_key" in table else None,
        most_sigma_m=table.number("most_sigma_m", 10.0, above=0.0, maximum=1000.0),
    )


def _integer(table: TomlTable, key: str, default: int, least: int, most: int) -> int:
    value = table.number(key, default, minimum=least, maximum=most)
    if value != int(value):
        raise table.fail(key, f"{value:g}", f"a whole number from {least} to {most}")
    return int(value)
