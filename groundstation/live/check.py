"""`groundstation check`: each device of a station file by itself, before the flight, and what is wrong in one line."""

import math
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from groundstation.errors import GroundstationError
from groundstation.live.check_disk import check_disk
from groundstation.live.check_reference import check_reference
from groundstation.live.check_result import CheckResult, failed, passed
from groundstation.live.devices import camera_of, check_against_rig
from groundstation.live.head_device import HeadDevice, open_head
from groundstation.live.keep_out_zones import sun_text, with_keep_out
from groundstation.live.live_stars import StarLoader, registered_heads
from groundstation.live.station_file import StationDevices, StationFile, load_station
from groundstation.rig.rig import Rig
from groundstation.rig.rig_limits import size_relation
from groundstation.sources.cameras.camera import CameraError, CameraEvent
from groundstation.tracking.config import load_config
from ptu_drivers.errors import PtuError
from ptu_drivers.interface import PanTiltUnit
from ptu_drivers.messages import NoReading, Reading

_LEAST_RATE_SHARE = 0.9
_TURN_RAD = math.radians(0.5)
_TURN_S = 3.0
# a round trip that long is half a pixel at 5 °/s and the lenses in use
_SLOW_S = 0.05


def check_station(path: Path, seconds: float, *, move: bool, stars: StarLoader | None = None) -> Iterator[CheckResult]:
    """Test everything that a station file names, one after the other; looks at each for ``seconds``.

    ``stars`` loads what takes head angles from stars, which the file may ask for.
    """
    try:
        file = load_station(path)
        rig = file.load_rig()
        check_against_rig(file, rig)
        load_config(file.config)
        file = with_keep_out(file, rig, time.monotonic(), time.time())
    except GroundstationError as fault:
        yield failed(str(fault))
        return
    yield passed(f"station file, rig and tuning: {', '.join(rig.names)}")
    yield _known(rig)
    if file.panorama is not None:
        yield _panorama(file, rig)
    if file.stars:
        yield _stars(file, rig, stars)
    if any(s.head is not None for s in file.stations):
        avoided, words = sun_text(file, rig, time.time())
        yield CheckResult(good=avoided, text=words)
    if file.reference is not None and file.origin is not None:
        yield check_reference(file.reference, file.origin, seconds)
    raw: dict[str, bool] = {}
    for station in file.stations:
        yield _camera(station, file.rate_hz, rig, seconds, raw)
        if station.head is not None:
            yield from _head(station.name, station.head, seconds, move=move)
    yield check_disk(file, rig, raw)


def _known(rig: Rig) -> CheckResult:
    try:
        rig.require_known()
    except GroundstationError as fault:
        return failed(str(fault))
    sure = [name for name in rig.names if not rig.station_covariance(name).names]
    if sure:
        text = f"rig: {', '.join(sure)} without a covariance: the track's covariance will be too small"
        return failed(text)
    return passed("rig: calibrated, with covariance")


def _panorama(file: StationFile, rig: Rig) -> CheckResult:
    """Read the panorama: one that cannot be used stops the operation, and nothing else."""
    try:
        names = file.registered_heads(rig).names
    except GroundstationError as fault:
        return failed(str(fault))
    return passed(f"panorama: {', '.join(names)}")


def _stars(file: StationFile, rig: Rig, load: StarLoader | None) -> CheckResult:
    """Load the stars: a lens without patterns or a missing extra stops the operation."""
    try:
        names = registered_heads(replace(file, panorama=None), rig, load, time.time()).names
    except GroundstationError as fault:
        return failed(str(fault))
    return passed(f"stars: {', '.join(names)}, at {datetime.now(UTC):%Y-%m-%d %H:%M:%S} UTC by this machine's clock")


def _camera(station: StationDevices, rate_hz: float, rig: Rig, seconds: float, raw: dict[str, bool]) -> CheckResult:
    """Look at one camera for a while; notes in ``raw`` whether its pictures have one byte a pixel."""
    name, events = f"{station.name} camera", list[CameraEvent]()
    frames, stamps = [], []
    try:
        with camera_of(station, time.monotonic, events.append, rate_hz=rate_hz) as camera:
            end_s = time.monotonic() + seconds
            while time.monotonic() < end_s and not camera.ended:
                frame = camera.read(0.2)
                if frame is not None:
                    frames.append(frame.picture.size_px)
                    stamps.append(frame.t_s)
                    raw[station.name] = frame.picture.pattern is not None
            counts, clock = camera.counts, camera.clock_state
    except CameraError as fault:
        return failed(f"{name}: {fault}")
    except GroundstationError as fault:
        # its text names the camera
        return failed(str(fault))
    wanted = rig[station.name].lens.image_size_px
    if frames and frames[-1] != wanted:
        got = f"{frames[-1][0]} × {frames[-1][1]} px"
        text = f"{name}: got pictures of {got}; wanted {wanted[0]} × {wanted[1]} px as in the rig"
        text += size_relation(frames[-1], wanted)
        return failed(text)
    if len(stamps) < 2:
        why = events[-1].text if events else "no frame received"
        return failed(f"{name}: no pictures in {seconds:g} s: {why}; is it triggered, and allowed?")
    rate = (len(stamps) - 1) / (stamps[-1] - stamps[0])
    text = f"{name}: {rate:.1f} Hz, {wanted[0]} × {wanted[1]} px"
    if rate < _LEAST_RATE_SHARE * rate_hz:
        return failed(f"{text}; wanted {rate_hz:g} Hz: exposure, trigger or bus?")
    if counts.incomplete:
        text += f"; {counts.incomplete} incomplete of {counts.frames + counts.incomplete}: cable, packet size?"
        return failed(text)
    reported = (
        "host time only: its stamps are as good as the bus"
        if clock is None
        else f"clock ± {1e3 * clock.sigma_s:.2f} ms"
    )
    return passed(f"{text}, {reported}")


def _head(name: str, head: HeadDevice, seconds: float, *, move: bool) -> Iterator[CheckResult]:
    """Ask one PTU for a while, and turn it if that is wanted."""
    with ExitStack() as stack:
        try:
            unit = stack.enter_context(open_head(name, head, time.monotonic))
        except GroundstationError as fault:
            yield failed(str(fault))
            return
        yield _asked(name, unit, seconds)
        if move:
            yield _turned(name, unit)


def _asked(name: str, unit: PanTiltUnit, seconds: float) -> CheckResult:
    about, trips, failures, newest = unit.describe(), list[float](), 0, None
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        reading = unit.read()
        if isinstance(reading, NoReading):
            failures += 1
            time.sleep(0.02)
        else:
            trips.append(reading.answered_s - reading.sent_s)
            newest = reading
    if newest is None:
        return failed(f"{name} PTU: {about.model or about.protocol} gives no angles")
    rate = len(trips) / seconds
    slow = float(np.percentile(trips, 95))
    pan, tilt = (math.degrees(axis.angle_rad) for axis in (newest.pan, newest.tilt))
    text = (
        f"{name} PTU: {about.model or about.protocol}, {rate:.0f} readings/s, "
        f"round trip {1e3 * np.median(trips):.1f} ms (95 % {1e3 * slow:.1f}), at {pan:+.2f}° {tilt:+.2f}°"
    )
    if failures > 0.01 * len(trips):
        return CheckResult(good=False, text=f"{text}; {failures} answers rejected: cable, baud, another program?")
    if slow > _SLOW_S:
        return failed(f"{text}: slow; raise the baud in ptu_settings?")
    return passed(text)


def _turned(name: str, unit: PanTiltUnit) -> CheckResult:
    """Turn pan and tilt by half a degree and back."""
    begin = unit.read()
    if isinstance(begin, NoReading):
        return failed(f"{name} PTU: not turned: no angles")
    pan, tilt = begin.pan.angle_rad, begin.tilt.angle_rad
    try:
        there = _went(unit, pan + _TURN_RAD, tilt + _TURN_RAD)
        back = _went(unit, pan, tilt)
    except PtuError as fault:
        return failed(f"{name} PTU: not turned: {fault}")
    if there is None or back is None:
        return CheckResult(good=False, text=f"{name} PTU: commanded to turn by 0.5°, not reached in {_TURN_S:.0f} s")
    return passed(f"{name} PTU: turned by 0.5° and back, there in {there:.2f} s")


def _went(unit: PanTiltUnit, pan_rad: float, tilt_rad: float) -> float | None:
    """Return how long it took to get to angles; None where it did not."""
    began_s = time.monotonic()
    unit.move_to(pan_rad=pan_rad, tilt_rad=tilt_rad)
    near = 3.0 * max(unit.describe().pan.quantum_rad, unit.describe().tilt.quantum_rad)
    while time.monotonic() - began_s < _TURN_S:
        now = unit.read()
        if isinstance(now, Reading):
            off = max(abs(now.pan.angle_rad - pan_rad), abs(now.tilt.angle_rad - tilt_rad))
            if off <= near:
                return time.monotonic() - began_s
    return None
