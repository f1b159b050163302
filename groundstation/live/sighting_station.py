"""One station with its camera and head: pictures taken while the head stands, each with its angles and time."""

import math
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType

import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.errors import ConfigError, GroundstationError, InputError
from groundstation.live.devices import Tell, camera_of, check_against_rig
from groundstation.live.guarded_head import GuardedHead
from groundstation.live.head_device import DeviceError
from groundstation.live.station_file import StationDevices, StationFile, load_station
from groundstation.rig.rig import Rig, Station
from groundstation.rig.rig_limits import size_relation
from groundstation.session.folder import GeoOrigin
from groundstation.sources.cameras.camera import CameraError, CameraFrame
from groundstation.sources.cameras.live_camera import LiveCamera
from ptu_drivers.messages import Reading
from ptu_drivers.monitor import MoveResult

_PICTURE_S = 10.0
_LOOK_S = 0.2
# a movement smaller than this gives no sense to a backlash
_SENSE_RAD = math.radians(0.01)
# of a long exposure, the rest is for reading the sensor
_SHARE_OF_PERIOD = 0.8


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StandingPicture:
    """A picture (h, w, 3) BGR taken while the head stood.

    ``t_s`` is its mid-exposure in Unix time, ``angles_rad`` (2,) pan and tilt as the encoder reads them, the median of
    the readings around it, ``mean_rad`` (2,) their mean; zero of a fixed station.
    """

    t_s: float
    image: ImageArray
    angles_rad: FloatArray
    mean_rad: FloatArray


class SightingStation:
    """Camera and head of one station of a station file, opened on ``with``.

    Parameters
    ----------
    rate_rad_s : speed of the head's moves, rad/s; None is slow.
    tell : called with the camera's events. report : called with lines about the head.
    exposure_s, gain : in place of the station file's; None keeps them. Pictures then come as slowly as they have to.
    rig, origin : in place of the station file's, for the keep-out zones, too; None keeps them.

    Raises `ConfigError`, `RigError`, `DeviceError`, `CameraError`.
    """

    def __init__(
        self,
        path: Path,
        name: str,
        *,
        rate_rad_s: float | None,
        tell: Tell,
        report: Callable[[str], None],
        exposure_s: float | None = None,
        gain: float | None = None,
        rig: Rig | None = None,
        origin: GeoOrigin | None = None,
    ) -> None:
        self._file: StationFile = load_station(path)
        rig = self._file.load_rig() if rig is None else rig
        check_against_rig(self._file, rig)
        devices = {s.name: s for s in self._file.stations}
        if name not in devices:
            raise ConfigError(f"{path}: station", got=name, wanted=f"one of {', '.join(devices)}")
        self.calibrated: Station = rig[name]
        self.senses = (0, 0)
        """The last direction of motion of pan and tilt, 1 or -1; 0 before the first."""
        asked = {key: value for key, value in (("exposure_s", exposure_s), ("gain", gain)) if value is not None}
        if devices[name].camera.startswith("file:"):
            # pictures that have been taken
            asked = {}
        self._devices: StationDevices = replace(
            devices[name], camera_settings={**devices[name].camera_settings, **asked}
        )
        slowest = np.inf if exposure_s is None else _SHARE_OF_PERIOD / exposure_s
        self._rate_hz = float(min(self._file.rate_hz, slowest))
        self._tell = tell
        head = self._devices.head
        self._head = (
            None
            if head is None
            else GuardedHead(path, name, head, rate_rad_s=rate_rad_s, report=report, rig=rig, origin=origin)
        )
        self._stack, self._opened = ExitStack(), ExitStack()
        self._camera: LiveCamera | None = None
        self._utc_zero_s = time.time() - time.monotonic()

    def __enter__(self) -> "SightingStation":
        with ExitStack() as stack:
            if self._head is not None:
                stack.enter_context(self._head)
            stack.callback(self._opened.close)
            self._open_camera()
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    @property
    def name(self) -> str:
        """The station's name."""
        return self._devices.name

    @property
    def turns(self) -> bool:
        """Whether it has a head."""
        return self._head is not None

    def angles(self) -> FloatArray:
        """Return pan and tilt (2,), rad, as the encoder reads them now; zero of a fixed station."""
        return np.zeros(2) if self._head is None else _angles(self._head.read())

    def turn_to(self, pan_rad: float, tilt_rad: float) -> tuple[MoveResult, ...]:
        """Turn the head to readings, rad, and wait until it stands; raises `DeviceError`."""
        if self._head is None:
            raise DeviceError(f"{self.name}: got a turn of a fixed station; wanted one with a PTU")
        before = self.angles()
        moved = self._head.turn_to(pan_rad, tilt_rad)
        ways = self.angles() - before
        pan, tilt = (
            (1 if way > 0.0 else -1) if abs(way) > _SENSE_RAD else old
            for way, old in zip(ways, self.senses, strict=True)
        )
        self.senses = (pan, tilt)
        return moved

    def pictures(self, count: int, readings: int) -> Iterator[StandingPicture]:
        """Yield pictures of one stop; raises `GroundstationError` where none comes or the head moves meanwhile."""
        first: FloatArray | None = None
        for _ in range(count):
            taken = self._picture(readings)
            if first is None:
                first = taken.angles_rad
            self._require_standing(np.array([first, taken.angles_rad]))
            yield taken

    def _picture(self, readings: int) -> StandingPicture:
        began_s = time.monotonic()
        read = [self.angles() for _ in range(readings // 2)]
        frame = self._frame(began_s)
        read += [self.angles() for _ in range(readings - len(read))]
        angles = np.array(read)
        self._require_standing(angles)
        return StandingPicture(
            t_s=frame.t_s + self._utc_zero_s,
            image=frame.picture.whole(),
            angles_rad=np.median(angles, axis=0),
            mean_rad=angles.mean(axis=0),
        )

    def _require_standing(self, angles: FloatArray) -> None:
        """Raise `GroundstationError` where angles (n, 2), rad, are not those of one stop by `landmarks.angles`."""
        within = 8.0 * self.calibrated.angle_sigma_rad + self.calibrated.ptu_resolution_rad
        apart = float(np.ptp(angles, axis=0).max())
        if self._head is not None and apart > within:
            got = f"angles {math.degrees(apart):.4f} deg apart while pictures were taken"
            raise InputError(
                f"{self.name}: PTU", got=got, wanted=f"at most {math.degrees(within):.4f}: it stands still"
            )

    def _frame(self, after_s: float) -> CameraFrame:
        """Return a frame exposed after an instant of the monotonic clock."""
        end_s = time.monotonic() + _PICTURE_S
        while time.monotonic() < end_s:
            camera = self._camera
            if camera is None or camera.ended:
                # a video in place of a camera begins again
                self._opened.close()
                camera = self._open_camera()
            frame = camera.read(_LOOK_S)
            if frame is not None and frame.t_s >= after_s:
                self._require_size(frame)
                return frame
        raise GroundstationError(f"{self.name} camera: got no picture in {_PICTURE_S:g} s; is it triggered?")

    def _require_size(self, frame: CameraFrame) -> None:
        got, wanted = frame.picture.size_px, self.calibrated.lens.image_size_px
        if got != wanted:
            raise InputError(
                f"{self.name} camera",
                got=f"pictures of {got[0]} × {got[1]} px",
                wanted=f"{wanted[0]} × {wanted[1]} px as in the rig{size_relation(got, wanted)}",
            )

    def _open_camera(self) -> LiveCamera:
        camera = camera_of(self._devices, time.monotonic, self._tell, rate_hz=self._rate_hz)
        try:
            self._opened.enter_context(camera)
        except CameraError as fault:
            raise DeviceError(f"{self.name} camera: {str(fault).removeprefix('camera: ')}") from fault
        self._camera = camera
        return camera


def _angles(reading: Reading) -> FloatArray:
    return np.array([reading.pan.angle_rad, reading.tilt.angle_rad])
