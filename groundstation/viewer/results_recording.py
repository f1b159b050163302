"""A Rerun recording from a replay's tables, if the replay wrote none: track, triangulation, smoothed track."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import rerun as rr

from groundstation.files.csv_table import CsvTable
from groundstation.messages import Kinematics, TrackEstimate, TrackEvent, TrackStatus, TriangulationStatus
from groundstation.sinks.track_files import TRACK_COLUMNS
from groundstation.viewer.entity_paths import MAX_TIME_S
from groundstation.viewer.recording_file import written_recording
from groundstation.viewer.reference_lines import ReferenceLine, log_reference_line
from groundstation.viewer.scene import RunwayOutline, log_runway, log_styles, long_enough
from groundstation.viewer.track_channel import TrackChannel

_HALF_WIDTH_M = 5.0
_FLUSH_EPOCHS = 200
_NOTE = "made of track.csv: pictures, stations and references are in the session only"


def write_results_recording(folder: Path, path: Path, name: str) -> None:
    """Write a recording of the tables in ``folder``; a track without an estimate gives its statuses only.

    Raises `InputError` if track.csv is missing or unreadable, before anything is written.
    """
    # the tables are read to their end first: a stream that is opened leaves a file and two threads
    estimates = list(_estimates(folder / "track.csv"))
    smoothed = folder / "smoothed.csv"
    rows = [e for e in _estimates(smoothed) if e.kinematics is not None] if smoothed.is_file() else []
    with written_recording(path, "groundstation", name) as stream:
        _log_results(stream, estimates, rows)


def _log_results(
    stream: rr.RecordingStream, estimates: Sequence[TrackEstimate], smoothed: Sequence[TrackEstimate]
) -> None:
    stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    log_styles(stream)
    channel = TrackChannel()
    newest_s = 0.0
    for estimate in estimates:
        newest_s = estimate.t_s
        channel.add_estimate(estimate)
        if len(channel) >= _FLUSH_EPOCHS:
            _send(stream, channel)
    channel.add_event(TrackEvent(t_s=newest_s, level="info", text=_NOTE))
    _send(stream, channel)
    outline = RunwayOutline(left_m=-_HALF_WIDTH_M, right_m=_HALF_WIDTH_M)
    log_runway(stream, long_enough(outline, max(float(channel.upper_m[1]), 0.0)))
    points = [e.kinematics.position_runway_m for e in smoothed if e.kinematics is not None]
    if points:
        t_s = np.array([e.t_s for e in smoothed])
        log_reference_line(stream, ReferenceLine(name="smoothed", t_s=t_s, position_runway_m=np.array(points)))


def _send(stream: rr.RecordingStream, channel: TrackChannel) -> None:
    for batch in channel.take():
        # delays are not in the tables
        if not batch.entity.startswith("plots/"):
            batch.send(stream)


def _estimates(path: Path) -> Iterator[TrackEstimate]:
    """Read a track.csv row by row."""
    table = CsvTable(path, TRACK_COLUMNS)
    statuses = {s.value: s for s in TrackStatus}
    for epoch, row in enumerate(table):
        values = [table.optional_number(row, column) for column in TRACK_COLUMNS[1:-1]]
        known = [v for v in values if v is not None]
        kinematics = None
        if len(known) == len(values):
            covariance = np.zeros((6, 6))
            covariance[np.triu_indices(3)] = known[6:]
            covariance[:3, :3] += np.triu(covariance[:3, :3], 1).T
            kinematics = Kinematics(
                position_runway_m=np.array(known[:3]), velocity_runway_m_s=np.array(known[3:6]), covariance=covariance
            )
        t_s = table.number(row, "t_s")
        if abs(t_s) > MAX_TIME_S:
            raise table.fault(row.line, got=f"t_s = {t_s:g}", wanted=f"at most {MAX_TIME_S:g} s")
        status = statuses.get(row.text["status"])
        if status is None:
            raise table.fault(row.line, got=f"status {row.text['status']!r}", wanted=", ".join(statuses))
        yield TrackEstimate(
            epoch=epoch,
            t_s=t_s,
            status=status,
            kinematics=kinematics,
            triangulation=None,
            triangulation_status=TriangulationStatus.ONE_VIEW,
            latency_s=0.0,
        )
