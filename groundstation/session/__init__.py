"""A recorded session on disk: what its tables say, which pictures there are, and the two references.

`load_session` reads session.toml and rig.toml and checks the rest as far as that is cheap; frames, PTU rows
and detections are streamed by `groundstation.sources.folder_source`. `load_dgps` and `load_truth` are apart from it,
since a broken reference must not keep a recording from being tracked.
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
