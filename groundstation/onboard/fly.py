"""A nose camera's video and the inertial unit's log in, the trajectory relative to the runway out."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from groundstation.arrays import ImageArray
from groundstation.errors import InputError, ending_noted, os_words
from groundstation.onboard.edges.camera_file import CameraFileError, NoseCamera, load_nose_camera
from groundstation.onboard.edges.config import TrackerConfig, config_by_poses
from groundstation.onboard.edges.imu_file import PoseLog, load_imu, refused_line
from groundstation.onboard.edges.picture_poses import PicturePose, PicturePoses
from groundstation.onboard.edges.pose_drift import NO_DRIFT
from groundstation.onboard.edges.undistortion import Undistorter
from groundstation.onboard.fly_sinks import FlyRecording, draw_sight
from groundstation.onboard.pose.agreement import PositionTrack, compare_positions
from groundstation.onboard.pose.inertial_filter import ImuSample
from groundstation.onboard.pose.pose_files import Runways
from groundstation.onboard.pose.runway import Runway, rectangle
from groundstation.onboard.visual_inertial.config import ApproachConfig, CornerMethod
from groundstation.onboard.visual_inertial.corner_finder import FoundCorners
from groundstation.onboard.visual_inertial.ground_track import read_ground_track
from groundstation.onboard.visual_inertial.inertial_unit_file import has_poses, load_unit, read_samples
from groundstation.onboard.visual_inertial.lasting_errors import KnownHeight
from groundstation.onboard.visual_inertial.nose_navigator import NoseNavigator
from groundstation.onboard.visual_inertial.nose_report import NoseFix, NoseReport
from groundstation.onboard.visual_inertial.outcome_text import PictureOutcomes, what_failed
from groundstation.onboard.visual_inertial.track_file import NoseFiles, agreement_words, write_agreement
from groundstation.sinks.overlay_video import OverlayVideo
from groundstation.sources.video_file import VideoFile, VideoFrame, refuse_other_times


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundTrack:
    """The ground's track: its file, the threshold in its frame (3 numbers, m), sigma where it states none, m."""

    path: Path
    threshold_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    sigma_m: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class FlyRequest:
    """Options of the user; ``runway`` is (table, airport, runway) or None for the camera file's rectangle."""

    video: Path
    camera: Path
    imu: Path
    out: Path
    runway: tuple[Path, str, str] | None = None
    corners: CornerMethod = CornerMethod.EDGES
    ground: GroundTrack | None = None
    rerun: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class FlyResult:
    """The result: pictures by outcome, epochs by the filter's status, agreement, files, a fault.

    ``agrees`` is True without a ground track; ``agreement`` is the result in words. ``unused`` is the reason
    why no picture's pose was used; empty where one was. ``damage`` describes the pictures that could not be decoded,
    None where all could. ``pose_lines``: rows of the log that are not used, and `PicturePoses.lines`.
    """

    outcomes: dict[str, int]
    statuses: dict[str, int]
    agreement: str
    agrees: bool
    unused: str
    files: tuple[Path, ...]
    fault: InputError | None
    damage: str | None
    pose_lines: tuple[str, ...] = ()


def fly_video(request: FlyRequest, progress: Callable[[int, int | None], None] = lambda done, total: None) -> FlyResult:
    """Follow the runway through a video and write the trajectory.

    Raises `InputError` where nothing can be done at all; a fault met on the way is in the result.
    """
    camera = load_nose_camera(request.camera)
    if request.runway is None and camera.unsaid:
        raise CameraFileError(
            f"{request.camera}: runway",
            got=f"no {' and no '.join(camera.unsaid)}",
            wanted="the runway's own size in m, or --runways FILE and --runway AIRPORT_RUNWAY",
        )
    samples = read_samples(request.imu)
    log = load_imu(request.imu, camera) if has_poses(request.imu) else None
    if log is None and camera.start is None:
        raise CameraFileError(
            f"{request.camera}: start", got="nothing", wanted="a [start] table, or attitude and place in --imu"
        )
    ground = None
    if request.ground is not None:
        reported = request.ground
        ground = read_ground_track(reported.path, np.array(reported.threshold_m), reported.sigma_m)
    video = VideoFile(request.video)
    refuse_other_times(request.imu, (samples[0].t_s, samples[-1].t_s), video)
    if ground is not None and request.ground is not None:
        refuse_other_times(request.ground.path, (float(ground.t_s[0]), float(ground.t_s[-1])), video)
    if video.size_px != camera.lens.image_size_px:
        w, h = video.size_px
        wanted = "×".join(str(n) for n in camera.lens.image_size_px) + " px as in the camera file"
        raise InputError(str(request.video), got=f"pictures of {w}×{h} px", wanted=wanted)
    try:
        request.out.mkdir(parents=True, exist_ok=True)
    except OSError as fault:
        raise InputError(str(request.out), got=os_words(fault), wanted="a folder that can be made") from fault
    unit = load_unit(request.camera, camera)
    config = ApproachConfig(inertial=unit.config, corners=request.corners)
    if request.runway is None and camera.width_sigma_m is not None:
        config = replace(config, width_sigma=camera.width_sigma_m / camera.guess.width_m)
    tracker = config_by_poses(camera.guess, None if log is None else camera.noise)
    navigator = NoseNavigator(_runway(request, camera), camera.lens, unit.mount, config, tracker)
    return _Flight(request, video, camera, navigator, log).run(samples, ground, progress)


def _runway(request: FlyRequest, camera: NoseCamera) -> Runway:
    if request.runway is None:
        return rectangle(camera.guess.length_m, camera.guess.width_m)
    table, airport, name = request.runway
    return Runways(table).find(airport, name)


class _Flight:
    """One run: pictures and samples in order of time through the navigator into the files."""

    def __init__(
        self, request: FlyRequest, video: VideoFile, camera: NoseCamera, navigator: NoseNavigator, log: PoseLog | None
    ) -> None:
        self._request, self._video, self._camera = request, video, camera
        self._navigator, self._log = navigator, log
        self._flat = Undistorter(camera.lens)
        self._poses = PicturePoses(self._flat.kappa, camera, log)

    def run(
        self,
        samples: Sequence[ImuSample],
        ground: PositionTrack | None,
        progress: Callable[[int, int | None], None],
    ) -> FlyResult:
        """Go through the video."""
        request, out = self._request, self._request.out
        outcomes = PictureOutcomes()
        statuses: Counter[str] = Counter()
        fixes: list[NoseFix] = []
        fault = None
        files = [out / "fly.mp4"]
        with ExitStack() as opened:
            tables = opened.enter_context(NoseFiles(out, self._camera.heading_rad))
            overlay = opened.enter_context(OverlayVideo(files[0], self._video.size_px, self._video.rate_hz))
            recording = None
            if request.rerun:
                files.append(out / "fly.rrd")
                runway = self._navigator.runway
                recording = opened.enter_context(FlyRecording(files[1], request.video.name, runway.corners_m, ground))
            opened.enter_context(ending_noted(lambda: f"its tables end after {statuses.total()} pictures"))
            try:
                for frame, report in self._reports(samples):
                    corners = report.corners
                    seen = self._flat.original(corners.seen_px) if isinstance(corners, FoundCorners) else None
                    tables.write(frame.index, report, seen)
                    overlay.write(draw_sight(frame.image, frame.index, report, seen, self._flat))
                    if recording is not None:
                        recording.write(frame.image, report, seen, self._flat)
                    outcomes.count(report)
                    statuses["waiting" if report.fix is None else report.fix.status.value] += 1
                    if report.fix is not None:
                        fixes.append(report.fix)
                    progress(frame.index + 1, self._video.count)
            except InputError as error:
                fault = error
        words, agrees = "", True
        if ground is not None:
            both = compare_positions(ground, series_of(fixes)) if len(fixes) > 1 else None
            words = agreement_words(both)
            if both is not None:
                agrees = both.agree
                files.append(out / "agreement.csv")
                write_agreement(files[-1], both)
        return FlyResult(
            outcomes=dict(outcomes.counts),
            statuses=dict(statuses),
            agreement=words,
            agrees=agrees,
            unused=what_failed(outcomes, self._navigator.runway.length_m, self._navigator.runway.width_m),
            files=(*tables.files, *files),
            fault=fault,
            damage=self._video.lost_line(),
            pose_lines=(*refused_line(self._log, request.imu), *self._poses.lines()),
        )

    def _reports(self, samples: Sequence[ImuSample]) -> Iterator[tuple[VideoFrame, NoseReport]]:
        """Yield each frame with its report; samples up to its time have been processed before."""
        fed = 0
        for frame in self._video.frames():
            while fed < len(samples) and samples[fed].t_s <= frame.t_s:
                self._navigator.process_imu(samples[fed])
                fed += 1
            image = self._flat.flat(frame.image)
            outside = self._outside(frame.t_s, image)
            pose, drift = (None, NO_DRIFT) if outside is None else (outside.pose, outside.drift)
            yield frame, self._navigator.update(frame.t_s, image, pose, self._height(outside), drift)

    def _height(self, outside: PicturePose | None) -> KnownHeight | None:
        """Return the log's height; the pictures' own motion has no other than that of the runway."""
        if outside is None or not outside.logged:
            return None
        noise, usual = self._camera.noise, TrackerConfig()
        return KnownHeight(
            up_m=float(outside.pose.camera_threshold_m[2]),
            lasting_m=noise.lasting_height_m or usual.lasting_height_m,
            noise_m=usual.position_sigma_m[2] if noise.position_m is None else noise.position_m,
        )

    def _outside(self, t_s: float, image: ImageArray) -> PicturePose | None:
        """Return a pose from the log, or from the pictures' motion as long as the filter needs one."""
        if self._log is None and self._navigator.needs_no_external_pose:
            return None
        return self._poses.of(t_s, image)


def series_of(fixes: Sequence[NoseFix]) -> PositionTrack:
    """Return the camera's positions as a series to compare."""
    return PositionTrack(
        t_s=np.array([fix.t_s for fix in fixes]),
        position_m=np.array([fix.position_m for fix in fixes]),
        covariance_m2=np.array([fix.covariance[:3, :3] for fix in fixes]),
    )


def format_fly_summary(result: FlyResult) -> str:
    """Return the result, in lines for the user."""
    pictures = sum(result.outcomes.values())
    lines = [
        f"{pictures} pictures: " + ", ".join(f"{name} {n}" for name, n in sorted(result.outcomes.items())),
        "trajectory: " + ", ".join(f"{name} {n}" for name, n in sorted(result.statuses.items())),
        *result.pose_lines,
    ]
    return "\n".join([*lines, result.agreement] if result.agreement else lines)
