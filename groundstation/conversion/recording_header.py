"""A session's own files as the header of a recording."""

from groundstation.files.text_file import TextFile
from groundstation.messages import InitialState
from groundstation.recording.mcap_metadata import CONFIG, REFERENCES, RIG, SESSION, RecordingHeader
from groundstation.session import Session
from groundstation.tracking.config import Config, config_to_mapping, config_to_toml


def build_header(
    session: Session,
    rig_file: TextFile | None,
    config: Config,
    *,
    initial: InitialState | None,
    learns_from_reference: bool,
) -> RecordingHeader:
    """Return the header of a run on a session; ``rig_file`` None is the session's own.

    Without another rig an early recording of operation is replayed as it was flown, uncorrected and by the DGPS clock
    of the station's name, and so are its events.
    """
    recorded = session.recorded
    rig = session.folder / RIG if rig_file is None else rig_file
    files = {
        SESSION: (session.folder / SESSION).read_bytes(),
        RIG: rig.read_bytes(),
        CONFIG: config_to_toml(config_to_mapping(config)).encode() + b"\n",
    }
    for name in REFERENCES:
        if (session.folder / name).is_file():
            files[name] = (session.folder / name).read_bytes()
    return RecordingHeader(
        name=session.name,
        files=files,
        pictures=not session.detections_only,
        initial=initial,
        learns_from_reference=learns_from_reference,
        left_out=tuple(sorted(session.left_out)),
        corrected=recorded is None or recorded.header.corrected or rig_file is not None,
        clock_by_identity=recorded is None or recorded.header.clock_by_identity or rig_file is not None,
    )
