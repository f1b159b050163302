"""The stream to an autopilot on its link, driven by the pipeline's thread."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from groundstation.autopilot.link_url import parse_link_url
from groundstation.autopilot.local_frame import LocalFrame
from groundstation.autopilot.mavlink_link import MavlinkLink
from groundstation.autopilot.message import MavlinkMessage
from groundstation.autopilot.received import receive
from groundstation.autopilot.settings import AutopilotSettings
from groundstation.autopilot.signing_key import read_signing_key
from groundstation.autopilot.status_text import status_texts
from groundstation.autopilot.stream import AutopilotStream, StreamClock
from groundstation.autopilot.vehicle_delay import asked_parameters
from groundstation.autopilot.vehicle_state import VehicleState
from groundstation.errors import ConfigError
from groundstation.messages import Kinematics, StepReport
from groundstation.session.folder import GeoOrigin

# a vehicle that has told nothing for longer is not heard
_SILENT_S = 5.0
_ASK_EVERY_S = 2.0
_ASKED_TIMES = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class AutopilotSummary:
    """What a stream did: states sent, withheld by reason, resets, ages of the newest picture, ms, dropped messages."""

    sent: int
    withheld: dict[str, int]
    resets: int
    age_p50_ms: float
    age_p99_ms: float
    dropped: int

    def text(self) -> str:
        """Return it in one line."""
        words = [f"{self.sent} states sent"]
        if self.sent:
            words.append(f"newest picture {self.age_p50_ms:.0f} ms old when sent, 99 % within {self.age_p99_ms:.0f} ms")
        words += [f"{n} withheld ({reason})" for reason, n in self.withheld.items()]
        words += [f"{self.resets} resets announced"] if self.resets else []
        words += [f"{self.dropped} dropped, the link being slower"] if self.dropped else []
        return ", ".join(words)


class AutopilotOutput:
    """Sends what the stream says, and keeps what the vehicle tells.

    Parameters
    ----------
    settings : link and stream.
    origin : of the runway frame on Earth.
    geoid_separation_m : there, if the settings do not state it.
    clock : of the link.
    session_s : the session's clock; called from any thread.
    estimate_at : as `AutopilotStream`.

    Raises `ConfigError` or `MissingExtraError`.
    """

    def __init__(
        self,
        settings: AutopilotSettings,
        origin: GeoOrigin | None,
        geoid_separation_m: float | None,
        clock: StreamClock,
        session_s: Callable[[], float],
        estimate_at: Callable[[float], Kinematics | None],
    ) -> None:
        frame = _frame(settings, origin, geoid_separation_m)
        self.vehicle = VehicleState()
        self.settings = settings
        self._clock = clock
        self._stream = AutopilotStream(settings, frame, clock, estimate_at)
        key = None if settings.signing_key is None else read_signing_key(settings.signing_key)
        self._link = MavlinkLink(
            parse_link_url(settings.url),
            (settings.system_id, settings.component_id),
            session_s,
            lambda: clock.link_us(session_s()) * 1000,
            key,
        )
        self._asked: Counter[str] = Counter()
        self._asked_s = -_ASK_EVERY_S
        self._text_id = 0

    def note(self, report: StepReport) -> None:
        """Note what the pipeline answered."""
        self._stream.note(report)

    def pass_time(self, now_s: float) -> None:
        """Take what the vehicle sent, and send what is due at session time ``now_s``."""
        for message in self._link.received():
            receive(
                self.vehicle,
                message.name,
                message.fields,
                message.source,
                message.received_s,
                link_s=self._clock.link_s,
                target_system=self.settings.target_system,
            )
        self._link.send([*self._questions(now_s), *self._stream.messages(now_s, self.vehicle)])

    def send_text(self, severity: int, text: str) -> None:
        """Send a STATUSTEXT; ``severity`` as MAV_SEVERITY: 2 critical, 4 warning, 6 information."""
        self._text_id = self._text_id % 65_535 + 1
        self._link.send(status_texts(severity, text, self._text_id))

    def status_text(self, now_s: float) -> str:
        """Return the stream's state in a line for the operator."""
        heard_s = self.vehicle.heard_s
        heard = heard_s is not None and now_s - heard_s <= _SILENT_S
        words = [f"autopilot: {self._stream.statistics.sent} states sent"]
        if self._stream.silent_because:
            words = [f"autopilot: silent, {self._stream.silent_because}"]
        if not heard:
            words.append("vehicle not heard")
        if doubt := self._stream.doubt(self.vehicle):
            words.append(doubt)
        if self._link.refused:
            words.append(f"{self._link.refused} messages refused (checksum or signature)")
        if self._link.fault:
            words.append(f"link: {self._link.fault}")
        return ", ".join(words)

    def summary(self) -> AutopilotSummary:
        """Return what was sent."""
        done = self._stream.statistics
        p50, p99 = (1e3 * float(np.percentile(done.ages_s, q)) if done.ages_s else 0.0 for q in (50, 99))
        return AutopilotSummary(
            sent=done.sent,
            withheld=dict(done.withheld),
            resets=done.resets,
            age_p50_ms=p50,
            age_p99_ms=p99,
            dropped=self._link.dropped,
        )

    def close(self) -> None:
        """Close the link."""
        self._link.close()

    def _questions(self, now_s: float) -> list[MavlinkMessage]:
        """Return requests for the vehicle's parameters that the stream depends on, until they are answered."""
        system = self.vehicle.system
        if system is None or now_s < self._asked_s + _ASK_EVERY_S:
            return []
        self._asked_s = now_s
        missing = [
            name
            for name in asked_parameters(self.settings, self.vehicle)
            if name not in self.vehicle.parameters and self._asked[name] < _ASKED_TIMES
        ]
        self._asked.update(missing)
        return [
            MavlinkMessage(
                name="PARAM_REQUEST_READ",
                fields={
                    "target_system": system,
                    "target_component": 1,
                    "param_id": name.encode(),
                    "param_index": -1,
                },
            )
            for name in missing
        ]


def _frame(settings: AutopilotSettings, origin: GeoOrigin | None, geoid_separation_m: float | None) -> LocalFrame:
    if origin is None:
        wanted = "a table [origin] (lat_deg, lon_deg, height_m, y_axis_azimuth_deg): where the runway frame is on Earth"
        raise ConfigError("autopilot", got="no origin", wanted=wanted)
    stated = settings.geoid_separation_m
    separation_m = geoid_separation_m if stated is None else stated
    if separation_m is None:
        wanted = "geoid_separation_m, height of the geoid above the ellipsoid: autopilots count from sea level"
        raise ConfigError("autopilot", got="no geoid separation", wanted=wanted)
    return LocalFrame(origin, separation_m)
