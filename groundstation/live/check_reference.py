"""`groundstation check` of the reference receiver: does it give positions, how good, how old, of here?"""

import time

import numpy as np

from groundstation.errors import GroundstationError
from groundstation.live.check_result import CheckResult, failed, passed
from groundstation.live.reference_device import ReferenceDevice
from groundstation.live.reference_fixes import ReferenceClock, ReferenceConverter
from groundstation.live.reference_line import open_reference_line
from groundstation.live.reference_set_up import gps_time_of
from groundstation.messages import DgpsFix
from groundstation.session.folder import GeoOrigin
from groundstation.session.logs.fixes import FixQuality, LogFix, LogOptions
from groundstation.session.logs.nmea_stream import NmeaStream

_QUIET_S = 0.04
_GOOD = (FixQuality.FIX, FixQuality.FLOAT, FixQuality.SIMULATED, FixQuality.PPP)


def check_reference(device: ReferenceDevice, origin: GeoOrigin, seconds: float) -> CheckResult:
    """Listen to the receiver for a while."""
    start_s = time.monotonic()
    clock = ReferenceClock(gps_time_of(start_s), device.clock_offset_s)
    converter = ReferenceConverter(origin, clock, None)
    stream = NmeaStream("DGPS", LogOptions(geoid_separation_m=device.geoid_separation_m))
    found: list[tuple[LogFix, DgpsFix, float]] = []
    refused: list[str] = []
    heard, strangers = 0, ""
    try:
        line = open_reference_line(device)
        try:
            while time.monotonic() - start_s < seconds:
                data = line.read(_QUIET_S)
                heard += len(data)
                for fix in stream.feed(data, time.time()) if data else stream.quiet(time.time()):
                    arrived_s = time.monotonic() - start_s
                    placed = converter.convert(fix, arrived_s)
                    if placed.antenna is not None:
                        found.append((fix, placed.antenna, arrived_s - placed.antenna.t_s))
                    elif placed.refusal is not None:
                        refused.append(placed.refusal.value)
            if line.refused:
                strangers = f"; {line.refused} datagrams refused, the last of {line.refused_sender}: see senders"
        finally:
            line.close()
    except GroundstationError as fault:
        return failed(f"DGPS: {fault}")
    reported = _reported(found, refused, heard, stream, clock, seconds)
    return CheckResult(good=reported.good, text=reported.text + strangers)


def _reported(
    found: list[tuple[LogFix, DgpsFix, float]],
    refused: list[str],
    heard: int,
    stream: NmeaStream,
    clock: ReferenceClock,
    seconds: float,
) -> CheckResult:
    """Put what was heard into a line."""
    if not heard:
        return failed(f"DGPS: no data in {seconds:.0f} s: is it on, is the radio link up, is the baud right?")
    if not found:
        why = f"positions {refused[-1]}" if refused else stream.remarks.short()
        return failed(f"DGPS: {heard} bytes in {seconds:.0f} s and no position that can be used: {why}")
    ages = [age for _, _, age in found]
    fix, newest, _ = found[-1]
    level = 0.0 if newest.sigma_m is None else float(np.hypot(newest.sigma_m[0], newest.sigma_m[1]))
    away = float(np.linalg.norm(newest.position_runway_m))
    text = (
        f"DGPS: {len(found) / seconds:.1f} positions/s, {fix.quality.value}, ± {level:.2f} m level, "
        f"{float(np.median(ages)):.2f} s old when they come, {away:.0f} m from the origin"
    )
    if clock.adopted:
        return failed(f"{text}; its clock is {clock.offset_s:+.1f} s off this machine's: set one, or clock_offset_s")
    if fix.quality not in _GOOD:
        return failed(f"{text}: no corrections? wanted fix or float")
    return passed(text)
