"""The interface of all cameras: settings, frames, events, counts; and the part that each kind implements."""

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
    """A camera is missing, does not support a request, or has been lost; one line that a user can act upon."""


class CameraLostError(CameraError):
    """An open camera no longer responds."""


class CameraEndedError(CameraError):
    """A file has been read to its end."""


class StampPoint(StrEnum):
    """What moment of an exposure the camera's own stamp means."""

    START = "start"
    MIDDLE = "middle"
    END = "end"


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraSettings:
    """Requested settings of a camera; None leaves a value unchanged.

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
    """Relation between a frame's arrival and its exposure (docs/cameras.md).

    Parameters
    ----------
    stamp : meaning of the device's stamp.
    transfer_s, transfer_sigma_s : from the end of the exposure to the arrival without other load; None:
        estimated by the kind of camera, for GenICam from the size of a picture and the link.
    link_mbit_s : of the network or the bus.
    exposure_s : used where the camera does not report its own.
    """

    stamp: StampPoint = StampPoint.START
    transfer_s: float | None = None
    transfer_sigma_s: float | None = None
    link_mbit_s: float = 1000.0
    exposure_s: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraSupervision:
    """Conditions of the loss of a camera, and of its reopening.

    Parameters
    ----------
    silent_after_s : time without a frame after which it is reopened; longer than the longest pause between triggers.
    frozen_after_s : time of bitwise identical pictures after which it is reopened. Uniform ones do not count.
    backoff_s, most_backoff_s : pause before the first and, doubled each time, before any later attempt.
    queue : frames that wait to be fetched; the oldest is dropped, and counted.
    wait_at_start : continue where the camera cannot be opened at first, instead of an error.
    """

    silent_after_s: float = 2.0
    frozen_after_s: float = 1.0
    backoff_s: float = 0.25
    most_backoff_s: float = 4.0
    queue: int = 4
    wait_at_start: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class SettingsReadBack:
    """Settings read back from the camera; None where it does not report them. ``model`` is its maker and name."""

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
    """One frame as delivered by a device, complete or not.

    ``pixels`` (h, w) raw or (h, w, 3) BGR, uint8, its own memory; None where the frame is incomplete. ``device_ns`` is
    the device's stamp in ns, ``payload_bytes`` the transferred bytes.
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
        """Return the next frame, None where none arrived in time.

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
    index : the device's frame number unwrapped, otherwise counted; ``lost`` frames are missing just before it.
    opening : 0 until the camera is lost for the first time, and one more after each return; frames missing
        between two openings are in no count of lost frames.
    device_ns : the device's own stamp, ns; None where it has no clock.
    arrival_s : arrival in the host's clock, s.
    exposure_s, gain : as reported by the camera; None where it does not.
    repeated : the picture is bitwise identical to the one before it.
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
    """Kinds of camera events."""

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
    """An event of a camera at ``t_s`` of the host's clock; ``text`` describes it in plain words."""

    t_s: float
    camera: str
    kind: CameraEventKind
    text: str


@dataclass(slots=True, kw_only=True)
class CameraCounts:
    """Counts of the frames so far, and of each kind of event.

    ``frames`` were complete and delivered; ``incomplete`` lacked packets; ``lost`` never arrived, by their numbers;
    ``overtaken`` arrived late or twice; ``dropped`` waited too long in the queue; ``repeated`` are among the delivered.
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
        """Return the next frame, None where none arrived within ``timeout_s`` or the camera has ended."""

    @property
    @abstractmethod
    def ended(self) -> bool:
        """Whether no frame will ever come again."""

    @property
    @abstractmethod
    def counts(self) -> CameraCounts:
        """Return a copy of the counts so far."""

    @property
    @abstractmethod
    def read_back(self) -> SettingsReadBack | None:
        """Return the settings that were read back last; None where it never was open."""
