"""What is wanted of an approach besides its track, and how that is opened once there is a pipeline."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from groundstation.approach.approach_outputs import ApproachOutputs
from groundstation.autopilot.local_frame import LocalFrame
from groundstation.autopilot.output import AutopilotOutput
from groundstation.autopilot.settings import AutopilotSettings
from groundstation.autopilot.stream import StreamClock
from groundstation.landing_site.landing_site_file import LandingSite, load_landing_site
from groundstation.messages import Kinematics
from groundstation.rig.rig import Rig
from groundstation.session.folder import GeoOrigin
from groundstation.sinks.udp_json import UdpJsonSender


@dataclass(frozen=True, slots=True, kw_only=True)
class ApproachOptions:
    """``site`` asks for advice and landing reports, ``autopilot`` for a stream, ``udp`` (HOST:PORT) for JSON lines.

    A stream or JSON lines without a site have the advice of the default one (`LandingSite`).
    """

    site: LandingSite | None = None
    autopilot: AutopilotSettings | None = None
    udp: str | None = None

    @property
    def wanted(self) -> bool:
        """Whether any of them is."""
        return self.site is not None or self.autopilot is not None or self.udp is not None


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionTime:
    """A session's clock: ``now_s`` returns session time and may be called from any thread.

    Session time plus ``link_s`` is the host's monotonic clock, by which MAVLink's stamps count; plus ``unix_s`` it is
    Unix time.
    """

    now_s: Callable[[], float]
    link_s: float
    unix_s: float


def station_options(
    asked: ApproachOptions, landing_site: Path | None, autopilot: AutopilotSettings | None
) -> ApproachOptions:
    """Return what is asked for, over what a station's file asks for. Raises `ConfigError`."""
    site = asked.site
    if site is None and landing_site is not None:
        site = load_landing_site(landing_site)
    return ApproachOptions(site=site, autopilot=asked.autopilot or autopilot, udp=asked.udp)


def open_approach(
    options: ApproachOptions,
    rig: Rig,
    span_m: float | None,
    origin: GeoOrigin | None,
    geoid_separation_m: float | None,
    time: SessionTime,
    estimate_at: Callable[[float], Kinematics | None],
) -> ApproachOutputs:
    """Open what the options ask for; to be closed by `ApproachOutputs.close`.

    Parameters
    ----------
    rig, span_m, estimate_at : those of the pipeline.
    origin, geoid_separation_m : where the runway frame is on Earth; None where unknown: a stream raises then.

    Raises `ConfigError` for settings that cannot be used, or `MissingExtraError` without pymavlink.
    """
    autopilot, frame = None, None
    if options.autopilot is not None and options.autopilot.geoid_separation_m is not None:
        geoid_separation_m = options.autopilot.geoid_separation_m
    udp = None if options.udp is None else UdpJsonSender(options.udp)
    if options.autopilot is not None:
        clock = StreamClock(link_s=time.link_s, unix_s=time.unix_s)
        autopilot = AutopilotOutput(options.autopilot, origin, geoid_separation_m, clock, time.now_s, estimate_at)
    if origin is not None:
        # of JSON lines, heights are above the ellipsoid: no geoid is needed for them
        frame = LocalFrame(origin, geoid_separation_m or 0.0)
    site = LandingSite() if options.site is None else options.site
    return ApproachOutputs(rig, span_m, site, autopilot=autopilot, udp=udp, unix_s=time.unix_s, frame=frame)
