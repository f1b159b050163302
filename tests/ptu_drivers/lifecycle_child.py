"""A program that moves a unit and ends badly, for `test_lifecycle.py`; arguments: URL, how to move, how to end."""

import math
import signal
import sys
import time

from ptu_drivers import UnitSettings, open_ptu

# tests in the background or under nohup have these ignored, and children inherit that
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)
url, motion, end = sys.argv[1:]
# only silence is for the watchdog; a busy machine is not what is tested
unit = open_ptu(url, settings=UnitSettings() if end == "silence" else UnitSettings(watchdog_s=60.0))
print("open", flush=True)
sys.stdin.readline()


def work() -> None:
    if motion == "position":
        unit.move_to(pan_rad=unit.describe().pan.high_rad, rate_rad_s=math.radians(20))
    else:
        unit.move_at(pan_rad_s=math.radians(20), tilt_rad_s=0.0)
    time.sleep(0.2)
    print("moving", flush=True)
    if end == "exception":
        raise ZeroDivisionError
    for _ in range(600):
        if motion == "rate" and end != "silence":
            unit.move_at(pan_rad_s=math.radians(20), tilt_rad_s=0.0)
        time.sleep(0.05)


if end == "with":
    with unit:
        unit.move_to(pan_rad=unit.describe().pan.high_rad)
        print("moving", flush=True)
elif end == "return":
    # neither closed nor in a context: the end of the program has to do it
    unit.move_to(pan_rad=unit.describe().pan.high_rad)
    print("moving", flush=True)
else:
    work()
