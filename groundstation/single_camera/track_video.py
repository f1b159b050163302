"""Tracking in one video of one camera: open, find and follow, write the table and what else is asked for.

Frames flow through one at a time. What was done before a fault or an interrupt is in the files.
"""

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

from groundstation.box import Box
from groundstation.detection.config import DetectorKind
from groundstation.detection.pixel_track import PixelTrack
from groundstation.errors import InputError, UsageError, ending_noted
from groundstation.messages import Miss, MissReason, TrackStatus
from groundstation.single_camera.make_tracker import make_tracker
from groundstation.single_camera.pixel_track_file import PixelTrackFile
from groundstation.sinks.overlay_video import OverlayVideo, draw_track
from groundstation.sources.video_file import VideoFile, VideoFrame
from groundstation.tracking.warm_up import warm_up


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackRequest:
    """What the user asked for.

    Attributes
    ----------
    video, out : the video to read and the table to write.
    init : box in px around the target in the first frame; None to search for it.
    from_frame, to_frame : first and last frame, both included; None for the end of the video.
    save_video : an MP4 file to write the drawn pictures to, None for none.
    view : show them live in Rerun's viewer.
    detector : the classic one alone, or with the learned channel.
    """

    video: Path
    out: Path
    init: Box[float] | None = None
    from_frame: int = 0
    to_frame: int | None = None
    save_video: Path | None = None
    view: bool = False
    detector: DetectorKind = DetectorKind.LEARNED


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackResult:
    """What came of it; a gap is a run of frames without the target after it was first seen.

    ``start_confirmed`` states whether the target was in the box given; None where none was. ``damage`` states in words
    which frames could not be decoded, None where all could; they are frames without the target.
    """

    frames: int
    tracked: int
    first_seen: int | None
    first_seen_s: float | None
    longest_gap_frames: int
    longest_gap_s: float
    files: tuple[Path, ...]
    fault: InputError | None
    start_confirmed: bool | None
    damage: str | None


def track_video(
    request: TrackRequest,
    progress: Callable[[int, int | None], None] = lambda done, total: None,
    environment: Mapping[str, str] | None = None,
) -> TrackResult:
    """Track one video; ``progress`` gets the frames done and the frames in all, None where that is unknown.

    ``environment`` is the caller's (os.environ), for the viewer. Raises `InputError` where nothing can be done
    at all. A fault met on the way is in the result.
    """
    video = VideoFile(request.video)
    total = _checked(request, video)
    tally = _FrameCounts()
    fault: InputError | None = None
    drawn = False
    with ExitStack() as opened:
        table, sinks = _open_sinks(request, video, environment, opened)
        rows = _TableRows(table, tally, video)
        warm_up(request.detector)
        tracker = make_tracker(request.detector, video.size_px)
        begun = False
        opened.enter_context(ending_noted(lambda: f"{request.out.name} ends after {tally.frames} frames"))
        try:
            for frame in video.frames(request.from_frame, request.to_frame):
                if not begun and request.init is not None:
                    track = tracker.start(frame.image, frame.t_s, request.init)
                else:
                    track = tracker.step(frame.image, frame.t_s)
                begun = True
                rows.write(frame.index, track)
                for write in sinks:
                    write(frame, track)
                drawn = True
                progress(tally.frames, total)
            rows.finish()
            progress(tally.frames, total)
        except InputError as error:
            fault = error
    # without a frame there is no video
    files = [request.out] if request.save_video is None or not drawn else [request.out, request.save_video]
    confirmed = tracker.start_confirmed if request.init is not None and begun else None
    return tally.result(tuple(files), fault, confirmed, video.lost_line())


def format_track_summary(result: TrackResult) -> str:
    """Return a few lines for the terminal."""
    share = result.tracked / result.frames if result.frames else 0.0
    line = f"{result.frames} frames, target seen in {result.tracked} ({share:.1%})"
    if result.first_seen is None:
        return f"{line}; nothing was found"
    return (
        f"{line}\nfirst seen in frame {result.first_seen} at {result.first_seen_s:.2f} s; "
        f"longest gap {result.longest_gap_frames} frames, {result.longest_gap_s:.2f} s"
    )


@dataclass(slots=True, kw_only=True)
class _FrameCounts:
    """Counts over the frames so far."""

    frames: int = 0
    tracked: int = 0
    first_seen: tuple[int, float] | None = None
    gap: int = 0
    gap_from_s: float = 0.0
    longest: tuple[int, float] = field(default=(0, 0.0))

    def add(self, index: int, track: PixelTrack) -> None:
        """Count one frame."""
        self.frames += 1
        if track.status is TrackStatus.TRACKING:
            self.tracked += 1
            self.gap = 0
            self.gap_from_s = track.t_s
            if self.first_seen is None:
                self.first_seen = (index, track.t_s)
        elif self.first_seen is not None:
            self.gap += 1
            self.longest = max(self.longest, (self.gap, track.t_s - self.gap_from_s))

    def result(
        self, files: tuple[Path, ...], fault: InputError | None, start_confirmed: bool | None, damage: str | None
    ) -> TrackResult:
        """Return the counts."""
        return TrackResult(
            frames=self.frames,
            tracked=self.tracked,
            first_seen=None if self.first_seen is None else self.first_seen[0],
            first_seen_s=None if self.first_seen is None else self.first_seen[1],
            longest_gap_frames=self.longest[0],
            longest_gap_s=self.longest[1],
            files=files,
            fault=fault,
            start_confirmed=start_confirmed,
            damage=damage,
        )


class _TableRows:
    """The table's rows and their count: one for each frame, those included that could not be decoded."""

    def __init__(self, table: PixelTrackFile, tally: _FrameCounts, video: VideoFile) -> None:
        self._table, self._tally, self._video = table, tally, video
        self._damaged = 0
        self._newest: tuple[int, float, TrackStatus] | None = None

    def write(self, index: int, track: PixelTrack) -> None:
        """Write a frame's row, and before it those of the damaged frames that came before."""
        self._write_damaged((index, track.t_s))
        self._write(index, track)

    def finish(self) -> None:
        """Write the rows of the damaged frames after the last one that could be decoded."""
        self._write_damaged(None)

    def _write_damaged(self, coming: tuple[int, float] | None) -> None:
        """Write the rows of the frames that have turned out to be damaged, evenly between their neighbours' times."""
        period_s = 1.0 / self._video.rate_hz
        for index in self._video.lost[self._damaged :]:
            status = TrackStatus.SEARCHING
            if self._newest is not None:
                before, t_s, status = self._newest
                if coming is not None:
                    period_s = (coming[1] - t_s) / (coming[0] - before)
                t_s += (index - before) * period_s
            else:
                number, t_s = coming or (0, 0.0)
                t_s += (index - number) * period_s
            self._damaged += 1
            status = TrackStatus.COASTING if status is TrackStatus.TRACKING else status
            miss = Miss(reason=MissReason.NOT_RECORDED, detail="the frame cannot be decoded")
            self._write(index, PixelTrack(t_s=t_s, status=status, result=miss, roi=None, predicted_px=None))

    def _write(self, index: int, track: PixelTrack) -> None:
        self._table.write(index, track)
        self._tally.add(index, track)
        self._newest = (index, track.t_s, track.status)


def _checked(request: TrackRequest, video: VideoFile) -> int | None:
    """Refuse what cannot be tracked or would write over the video; return how many frames are to come, if known."""
    first, last = request.from_frame, request.to_frame
    if first < 0 or (last is not None and last < first):
        got = f"frames {first} to {'the end' if last is None else last}"
        raise UsageError("--from-frame, --to-frame", got=got, wanted="0 or later, and a start before the end")
    if video.count is not None and first >= video.count:
        got = f"a video of {video.count} frames"
        raise InputError(str(video.path), got=got, wanted=f"more, to start from frame {first}")
    if request.init is not None:
        x, y, (w, h) = request.init.x0, request.init.y0, request.init.size
        width, height = video.size_px
        if not (0 <= x + 0.5 * w < width and 0 <= y + 0.5 * h < height):
            got = f"a box at {x:g},{y:g} of {w:g} x {h:g} px"
            raise InputError("--init", got=got, wanted=f"one whose middle is in the picture of {width} x {height} px")
    if request.save_video is not None and request.save_video.suffix.lower() != ".mp4":
        raise UsageError("--save-video", got=str(request.save_video), wanted="the name of an .mp4 file")
    outputs = [request.out, *([] if request.save_video is None else [request.save_video])]
    for path in outputs:
        if not path.parent.is_dir():
            raise InputError(str(path), got=f"no folder {path.parent}", wanted="a file in a folder that exists")
    if request.save_video is not None and request.save_video.is_dir():
        raise InputError(str(request.save_video), got="Is a directory", wanted="a video that can be written")
    if video.count is None:
        return None if last is None else last - first + 1
    return min(video.count, video.count if last is None else last + 1) - first


def _open_sinks(
    request: TrackRequest, video: VideoFile, environment: Mapping[str, str] | None, opened: ExitStack
) -> tuple[PixelTrackFile, list[Callable[[VideoFrame, PixelTrack], None]]]:
    """Open everything that is written: the table, and sinks of which each takes a frame and its track."""
    sinks: list[Callable[[VideoFrame, PixelTrack], None]] = []
    if request.view:
        # imported here: without --view, the start does not wait for Rerun
        from groundstation.viewer.live_track import APPLICATION, LiveTrackView
        from groundstation.viewer.viewer_process import open_live_stream

        stream = open_live_stream(APPLICATION, environment or {}, "--save-video writes the same pictures into a file")
        view = opened.enter_context(LiveTrackView(stream, request.video.name))
        sinks.append(lambda frame, track: view.write(frame.image, track))
    table = opened.enter_context(PixelTrackFile(request.out))
    if request.save_video is not None:
        overlay = opened.enter_context(OverlayVideo(request.save_video, video.size_px, video.rate_hz))
        sinks.append(lambda frame, track: overlay.write(draw_track(frame.image, frame.index, track)))
    return table, sinks
