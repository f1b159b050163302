"""What every camera is to those who use it: settings, frames, events, counts; and what a make of camera has to do."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from types import TracebackType

from groundstation.arrays import ImageArray
from groundstation.errors import GroundstationError
from groundstation.picture import BayerPattern, Picture

Clock = Callable[[], float]
"""The host's monotonic clock, s; given from outside, so that a test can be the clock."""


class CameraError(GroundstationError):
    """A camera is not there, cannot do what was asked, or has been lost; one line that a user can act upon."""


class CameraLostError(CameraError):
    """A camera that was open does not answer any more."""


class CameraEndedError(CameraError):
    """A file has been read to its end."""


class StampPoint(StrEnum):
    """What moment of an exposure the camera's own stamp means."""

    START = "start"
    MIDDLE = "middle"
    END = "end"


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraSettings:
    """What a camera is told; None leaves a value as the camera has it.

    Parameters
    ----------
    exposure_s : exposure, s.
    gain : in the camera's own unit (mostly dB).
    roi_px : x, y, w, h on the sensor, px.
    trigger : "off", or the name of the input that starts each exposure, as "Line1".
    pixel_format : GenICam's name, as "BayerRG8"; a FOURCC for OpenCV.
    rate_hz : frames per second of a free-running camera.
    """

    exposure_s: float | None = None
    gain: float | None = None
    roi_px: tuple[int, int, int, int] | None = None
    trigger: str | None = None
    pixel_format: str | None = None
    rate_hz: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraTiming:
    """How a frame's arrival tells when it was exposed (docs/cameras.md).

    Parameters
    ----------
    stamp : what the device's stamp means.
    transfer_s, transfer_sigma_s : from the end of the exposure to the arrival when nothing is in the way; None:
        reckoned by the kind of camera, for GenICam from the size of a picture and the link.
    link_mbit_s : of the network or the bus.
    exposure_s : supposed where the camera does not tell its own.
    """

    stamp: StampPoint = StampPoint.START
    transfer_s: float | None = None
    transfer_sigma_s: float | None = None
    link_mbit_s: float = 1000.0
    exposure_s: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraSupervision:
    """When a camera counts as lost, and how it is sought again.

    Parameters
    ----------
    silent_after_s : without a frame for so long, it is reopened; longer than the longest pause between triggers.
    frozen_after_s : pictures that are identical to the last bit for so long: reopened. Flat ones do not count.
    backoff_s, most_backoff_s : pause before the first and, doubled each time, before any later attempt.
    queue : frames that wait to be fetched; the oldest is dropped, and counted.
    wait_at_start : go on where the camera cannot be opened at first, instead of an error.
    """

    silent_after_s: float = 2.0
    frozen_after_s: float = 1.0
    backoff_s: float = 0.25
    most_backoff_s: float = 4.0
    queue: int = 4
    wait_at_start: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class SettingsReadBack:
    """What the camera itself says it is set to; None where it does not tell. ``model`` is its maker and name."""

    model: str
    serial: str | None = None
    size_px: tuple[int, int] | None = None
    exposure_s: float | None = None
    gain: float | None = None
    roi_px: tuple[int, int, int, int] | None = None
    trigger: str | None = None
    pixel_format: str | None = None
    rate_hz: float | None = None
    device_clock: bool = False


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GrabbedFrame:
    """One frame as a device gave it, whole or not.

    ``pixels`` (h, w) raw or (h, w, 3) BGR, uint8, its own memory; None where the frame is incomplete. ``device_ns`` is
    the device's stamp in ns, ``payload_bytes`` what went over the link.
    """

    frame_id: int | None
    device_ns: int | None
    pixels: ImageArray | None
    pattern: BayerPattern | None
    payload_bytes: int
    due_s: float | None = None


class CameraDevice(ABC):
    """One connection to one camera, as each kind of camera makes it; used by one thread."""

    read_back: SettingsReadBack
    checks_frozen = True
    may_reopen = True
    transfer_s: float | None = None
    transfer_sigma_s: float | None = None

    @abstractmethod
    def grab(self, timeout_s: float) -> GrabbedFrame | None:
        """Return the next frame, None where none came in time.

        Raises `CameraLostError`, or `CameraEndedError` at the end of a file.
        """

    @abstractmethod
    def close(self) -> None:
        """Let the camera go, whatever state it is in; raises nothing."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraFrame:
    """One complete frame.

    Parameters
    ----------
    t_s, sigma_s : its mid-exposure in the host's clock and one sigma, s.
    index : the device's frame number unwrapped, else counted; ``lost`` frames are missing just before it.
    opening : 0 until the camera is lost for the first time, and one more whenever it has come back; what is missing
        between two openings is in no count of lost frames.
    device_ns : the device's own stamp, ns; None where it has no clock.
    arrival_s : when the host had it, in the host's clock, s.
    exposure_s, gain : as the camera says; None where it does not.
    repeated : the picture is the same as the one before it, to the last bit.
    """

    camera: str
    t_s: float
    sigma_s: float
    index: int
    lost: int
    opening: int
    device_ns: int | None
    arrival_s: float
    exposure_s: float | None
    gain: float | None
    picture: Picture
    repeated: bool


class CameraEventKind(StrEnum):
    """What can befall a camera."""

    OPENED = "opened"
    LOST = "lost"
    SILENT = "silent"
    FROZEN = "frozen"
    NOT_OPENED = "not opened"
    REOPENED = "reopened"
    RECOUNTED = "recounted"
    CLOCK_RESET = "clock reset"
    CLOCK_JUMP = "clock jump"
    ENDED = "ended"


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraEvent:
    """Something befell a camera at ``t_s`` of the host's clock; ``text`` says it in plain words."""

    t_s: float
    camera: str
    kind: CameraEventKind
    text: str


@dataclass(slots=True, kw_only=True)
class CameraCounts:
    """What became of the frames so far, and how often each event happened.

    ``frames`` were complete and handed on; ``incomplete`` lacked packets; ``lost`` never came, by their numbers;
    ``overtaken`` came late or twice; ``dropped`` waited too long in the queue; ``repeated`` are among the handed on.
    """

    frames: int = 0
    incomplete: int = 0
    lost: int = 0
    overtaken: int = 0
    dropped: int = 0
    repeated: int = 0
    reconnects: int = 0
    events: dict[CameraEventKind, int] = field(default_factory=dict)


class Camera(ABC):
    """A camera that runs between ``with`` and its end, whatever happens to the device meanwhile."""

    name: str

    @abstractmethod
    def __enter__(self) -> "Camera":
        """Open the camera and start it; raises `CameraError`."""

    @abstractmethod
    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop and close it."""

    @abstractmethod
    def read(self, timeout_s: float) -> CameraFrame | None:
        """Return the next frame, None where none came within ``timeout_s`` or the camera has ended."""

    @property
    @abstractmethod
    def ended(self) -> bool:
        """Whether no frame will ever come again."""

    @property
    @abstractmethod
    def counts(self) -> CameraCounts:
        """Return a copy of what has been counted so far."""

    @property
    @abstractmethod
    def read_back(self) -> SettingsReadBack | None:
        """Return what the camera was last found set to; None where it never was open."""
