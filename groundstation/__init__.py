"""Groundstation: where is the approaching aircraft, in 3-D, from two cameras on pan-tilt units.

From Python: `replay_session` replays a session and returns NumPy arrays, `Tracker` is fed event by event
(docs/python.md).
"""

# nothing is imported before `cli.start` stands ready for an interrupt; type checkers take this as true
TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.api.replay_session import CameraSeries, ReplayedSession, replay_session
    from groundstation.api.rig_file import load_rig
    from groundstation.api.session_events import session_events
    from groundstation.api.tracker import Tracker
    from groundstation.box import Box
    from groundstation.detection.detector_callback import TargetCandidate
    from groundstation.detection.working_image import DetectionHint
    from groundstation.errors import InputError
    from groundstation.messages import (
        CameraReport,
        Detection,
        DetectionStatus,
        Epoch,
        Frame,
        Heartbeat,
        InitialState,
        Kinematics,
        Miss,
        PixelMeasurement,
        PtuSample,
        ReferenceFix,
        StepReport,
        TrackEstimate,
        TrackState,
        TrackStatus,
        Triangulation,
    )
    from groundstation.rig.rig import Rig

__version__ = "0.1.0"
# where each public name is; what is not here may change without a note
_PLACES = {
    "groundstation.api.replay_session": ("replay_session", "ReplayedSession", "CameraSeries"),
    "groundstation.api.rig_file": ("load_rig",),
    "groundstation.api.session_events": ("session_events",),
    "groundstation.api.tracker": ("Tracker",),
    "groundstation.box": ("Box",),
    "groundstation.detection.detector_callback": ("TargetCandidate",),
    "groundstation.detection.working_image": ("DetectionHint",),
    "groundstation.errors": ("InputError",),
    "groundstation.messages": (
        *("PtuSample", "Frame", "PixelMeasurement", "Epoch", "Heartbeat", "ReferenceFix", "InitialState"),
        *("StepReport", "TrackEstimate", "TrackState", "TrackStatus", "Kinematics", "Triangulation"),
        *("CameraReport", "Detection", "DetectionStatus", "Miss"),
    ),
    "groundstation.rig.rig": ("Rig",),
}
_MODULE_OF = {name: module for module, names in _PLACES.items() for name in names}
__all__ = [
    "Box",
    "CameraReport",
    "CameraSeries",
    "Detection",
    "DetectionHint",
    "DetectionStatus",
    "Epoch",
    "Frame",
    "Heartbeat",
    "InitialState",
    "InputError",
    "Kinematics",
    "Miss",
    "PixelMeasurement",
    "PtuSample",
    "ReferenceFix",
    "ReplayedSession",
    "Rig",
    "StepReport",
    "TargetCandidate",
    "TrackEstimate",
    "TrackState",
    "TrackStatus",
    "Tracker",
    "Triangulation",
    "__version__",
    "load_rig",
    "replay_session",
    "session_events",
]


def __getattr__(name: str) -> object:
    """Import a public name when it is first used: the command line starts without what it does not need."""
    import importlib

    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_MODULE_OF[name]), name)


def __dir__() -> list[str]:
    """Return the public names, those that have not been imported yet among them."""
    return sorted(__all__)
