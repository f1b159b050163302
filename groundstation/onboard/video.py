"""Runway edges in a nose camera's video: open, track, write the table, the overlay and the Rerun recording."""

from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

from groundstation.errors import InputError, ending_noted, os_words
from groundstation.onboard.edges.camera_file import CameraFileError, NoseCamera, load_nose_camera
from groundstation.onboard.edges.config import config_by_poses
from groundstation.onboard.edges.edges_file import NO_POSE, EdgesFile, corner_pixels
from groundstation.onboard.edges.imu_file import PoseLog, load_imu, refused_line
from groundstation.onboard.edges.picture_poses import PicturePoses
from groundstation.onboard.edges.report import EdgeMiss, EdgeReport
from groundstation.onboard.edges.tracker import EdgeTracker
from groundstation.onboard.edges.undistortion import Undistorter
from groundstation.onboard.sinks import EdgesRecording, draw_edges
from groundstation.sinks.overlay_video import OverlayVideo
from groundstation.sources.video_file import VideoFile, refuse_other_times


@dataclass(frozen=True, slots=True, kw_only=True)
class EdgesRequest:
    """Options of the user: video, camera file, IMU table or None, output folder, Rerun or not."""

    video: Path
    camera: Path
    imu: Path | None
    out: Path
    rerun: bool = True


# what is likely at fault where no picture at all has a measurement
_NO_POSES = "no picture has a pose: are the table's times seconds of the video's clock?"
_NO_BANDS = (
    "by their poses the runway is in no picture: are the focal length, the table's units (degrees, m) and signs, "
    "[mount] and [start] right?"
)
_NO_RUNWAY = (
    "no picture shows the announced runway: are the camera file, the poses, the runway's width and length right?"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class EdgesResult:
    """The result: frames by status, frames without a measurement by reason, files, and a fault during the run.

    ``damage`` describes the frames that could not be decoded, None where all could; they have no row. ``pose_lines``:
    rows of the log that are not used, and `PicturePoses.lines`.
    """

    statuses: dict[str, int]
    misses: dict[str, int]
    files: tuple[Path, ...]
    fault: InputError | None
    damage: str | None
    pose_lines: tuple[str, ...] = ()


def track_edges(
    request: EdgesRequest, progress: Callable[[int, int | None], None] = lambda done, total: None
) -> EdgesResult:
    """Track the edges through a video.

    Raises `InputError` where nothing can be done at all; a fault met on the way is in the result.
    """
    camera = load_nose_camera(request.camera)
    poses = None if request.imu is None else load_imu(request.imu, camera)
    if poses is None and camera.start is None:
        raise CameraFileError(f"{request.camera}: start", got="nothing", wanted="a [start] table, or --imu")
    video = VideoFile(request.video)
    if poses is not None and request.imu is not None:
        refuse_other_times(request.imu, poses.span_s, video)
    if video.size_px != camera.lens.image_size_px:
        w, h = video.size_px
        wanted = "×".join(str(n) for n in camera.lens.image_size_px) + " px as in the camera file"
        raise InputError(str(request.video), got=f"pictures of {w}×{h} px", wanted=wanted)
    try:
        request.out.mkdir(parents=True, exist_ok=True)
    except OSError as fault:
        raise InputError(str(request.out), got=os_words(fault), wanted="a folder that can be made") from fault
    return _run(request, video, camera, poses, progress)


@dataclass(slots=True)
class _EdgeCounts:
    frames: int = 0
    statuses: Counter[str] = field(default_factory=Counter)
    misses: Counter[str] = field(default_factory=Counter)

    def count(self, report: EdgeReport | None) -> None:
        self.frames += 1
        self.statuses[NO_POSE if report is None else report.status.value] += 1
        if report is not None:
            self.misses[report.miss.value] += 1


def _run(
    request: EdgesRequest,
    video: VideoFile,
    camera: NoseCamera,
    log: PoseLog | None,
    progress: Callable[[int, int | None], None],
) -> EdgesResult:
    flat = Undistorter(camera.lens)
    poses = PicturePoses(flat.kappa, camera, log)
    config = config_by_poses(camera.guess, None if log is None else camera.noise)
    tracker = EdgeTracker(flat.kappa, camera.lens.image_size_px, config)
    files = [request.out / "edges.csv", request.out / "edges.mp4"]
    tally, fault = _EdgeCounts(), None
    with ExitStack() as opened:
        table = opened.enter_context(EdgesFile(files[0]))
        overlay = opened.enter_context(OverlayVideo(files[1], video.size_px, video.rate_hz))
        recording = None
        if request.rerun:
            files.append(request.out / "edges.rrd")
            recording = opened.enter_context(EdgesRecording(files[2], request.video.name, camera.guess.length_m))
        opened.enter_context(ending_noted(lambda: f"edges.csv ends after {table.rows} frames"))
        try:
            for frame in video.frames():
                image = flat.flat(frame.image)
                found = poses.of(frame.t_s, image)
                report = None if found is None else tracker.step(image, found.pose, found.drift)
                edges = None if report is None else report.edges
                corners = None if edges is None else flat.original(corner_pixels(edges))
                table.write(frame.index, frame.t_s, report, corners)
                overlay.write(draw_edges(frame.image, frame.index, frame.t_s, report, corners))
                if recording is not None:
                    recording.write(frame.image, frame.t_s, report, corners, None if found is None else found.pose)
                tally.count(report)
                progress(tally.frames, video.count)
        except InputError as error:
            fault = error
    return EdgesResult(
        statuses=dict(tally.statuses),
        misses=dict(tally.misses),
        files=tuple(files),
        fault=fault,
        damage=video.lost_line(),
        pose_lines=(*refused_line(log, request.imu), *poses.lines()),
    )


def format_edges_summary(result: EdgesResult) -> str:
    """Return the result, in lines for the user."""
    frames = sum(result.statuses.values())
    lines = [f"{frames} frames: " + ", ".join(f"{name} {count}" for name, count in sorted(result.statuses.items()))]
    misses = {name: count for name, count in result.misses.items() if name != "none"}
    if misses:
        lines.append("without a measurement: " + ", ".join(f"{name} {n}" for name, n in sorted(misses.items())))
    lines += result.pose_lines
    if frames and result.statuses.get(NO_POSE) == frames:
        lines.append(_NO_POSES)
    elif frames and misses.get(EdgeMiss.NO_BAND.value) == frames:
        lines.append(_NO_BANDS)
    elif frames and sum(misses.values()) == frames:
        lines.append(_NO_RUNWAY)
    return "\n".join(lines)
