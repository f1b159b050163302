"""Drives a FLIR unit with the package flirptu and prints what it saw; the argument is the serial port."""

import sys
import warnings

from flirptu import PTU

warnings.simplefilter("ignore")  # it warns of what we ask it to do wrong
unit = PTU(sys.argv[1], timeout=10)
print("echo", unit.echo, "resolution", unit.panResolution, unit.tiltResolution)
print("limits", unit.minPan, unit.maxPan, unit.minTilt, unit.maxTilt, "speed", unit.maxPanSpeed, unit.maxTiltSpeed)
print("pan", unit.setPanPosition(300, blocking=True), unit.getPanPosition(), unit.getTiltPosition())
print("tilt", unit.setTiltPositionOffset(-50, blocking=True), unit.getTiltPosition(), unit.getTargetPosition())
print("both", unit.setPositionAndSpeed(-20, 10, 500, 500, blocking=True), unit.getPosition(), unit.getTargetPanSpeed())
print("beyond", unit.setPanPosition(99999))
unit.echo = False
print("without echo", unit.getPanPosition())
