"""What a recorded session brings to its Rerun recording: its pictures, and the reference once evaluated."""

from pathlib import Path

from groundstation.evaluation.collector import ResultCollector
from groundstation.evaluation.evaluate import Evaluation, track_series
from groundstation.session import MediumKind, Session
from groundstation.sources.frame_table import own_numbers
from groundstation.sources.picture_reader import image_files
from groundstation.viewer.media import MEDIA_TYPES, ImageFolder, Media, RecordedWindows, VideoAsset
from groundstation.viewer.reference_lines import AxisErrors, ReferenceLine, ReferenceTracks
from groundstation.viewer.rerun_sink import RerunSink


def session_view(path: Path, session: Session) -> RerunSink:
    """Open the recording of a session's replay; videos are embedded, not encoded again, where Rerun can read them.

    Of a recording (.mcap) those windows of the pictures are shown that were kept.
    """
    media: dict[str, Media] = {}
    numbers = own_numbers(session) if session.media and session.recorded is None else {}
    for name, medium in session.media.items():
        own = numbers.get(name)
        if medium.kind is MediumKind.VIDEO:
            media[name] = VideoAsset(path=medium.path, frame_numbers=own)
        elif medium.kind is MediumKind.IMAGES:
            files = image_files(medium.path)
            if own is not None:
                files = {pair: files[number] for pair, number in own.items() if number in files}
            plain = all(path.suffix.lower() in MEDIA_TYPES for path in files.values())
            media[name] = ImageFolder(files=files) if plain else RecordedWindows(expected=len(files))
        else:
            media[name] = RecordedWindows()
    return RerunSink(path, session.rig, session_name=session.name, media=media)


def reference_tracks(evaluation: Evaluation, smoothed: ResultCollector | None = None) -> ReferenceTracks:
    """Return the references as lines, and the errors against the better one: truth if there is one.

    ``smoothed`` is the track given the whole flight, if it was smoothed.
    """
    lines = []
    if smoothed is not None:
        track = track_series(smoothed.epochs())
        if len(track):
            lines.append(ReferenceLine(name="smoothed", t_s=track.t_s, position_runway_m=track.position_m))
    if evaluation.truth is not None:
        lines.append(
            ReferenceLine(name="truth", t_s=evaluation.truth.t_s, position_runway_m=evaluation.truth.position_m)
        )
    if evaluation.reference is not None:
        series = evaluation.reference.all_fixes
        t_s = series.t_s - evaluation.reference.applied_offset_s
        lines.append(ReferenceLine(name="dgps", t_s=t_s, position_runway_m=series.position_m))
    errors = None
    for name in ("truth", "dgps"):
        comparison = evaluation.comparisons.get(name)
        if comparison is not None and comparison.ekf_known.any():
            known = comparison.ekf_known
            sigma = comparison.covariance_m2[known].diagonal(axis1=1, axis2=2) ** 0.5
            errors = AxisErrors(
                against=name,
                t_s=comparison.t_s[known],
                error_m=comparison.ekf_error_m[known],
                sigma_m=sigma,
            )
            break
    return ReferenceTracks(lines=tuple(lines), errors=errors)
