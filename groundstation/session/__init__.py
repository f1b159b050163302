"""A recorded session on disk: its tables, its pictures, and the two references.

`load_session` reads session.toml and rig.toml and checks the rest as far as that is cheap; frames, PTU rows
and detections are streamed by `groundstation.sources.folder_source`. `load_dgps` and `load_truth` are separate,
because a faulty reference must not prevent tracking.
"""

from groundstation.session.folder import BackgroundPhase, GeoOrigin, RecordingInfo, Session, TargetModel
from groundstation.session.load import load_session
from groundstation.session.media import Medium, MediumKind
from groundstation.session.references import Truth, load_dgps, load_truth

__all__ = [
    "BackgroundPhase",
    "GeoOrigin",
    "Medium",
    "MediumKind",
    "RecordingInfo",
    "Session",
    "TargetModel",
    "Truth",
    "load_dgps",
    "load_session",
    "load_truth",
]
