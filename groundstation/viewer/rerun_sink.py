"""The Rerun recording ``session.rrd``: scene, pictures with overlay, plots and log on one timeline."""

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
import rerun as rr

from groundstation.errors import InputError, SessionError
from groundstation.landing_site.runway import LandingRunway
from groundstation.messages import CameraReport, StepReport, TrackEvent
from groundstation.rig.rig import Rig
from groundstation.sources.video_file import VideoFile
from groundstation.viewer import entity_paths
from groundstation.viewer.approach_channel import ApproachChannel
from groundstation.viewer.approach_row import ApproachRow
from groundstation.viewer.blueprint import Viewpoint, blueprint, eye_before, eye_over, live_blueprint
from groundstation.viewer.camera_channel import CameraChannel
from groundstation.viewer.columns import ColumnBatch
from groundstation.viewer.media import EmbeddedVideo, ImageFolder, Media, VideoAsset, log_video
from groundstation.viewer.picture_channel import PictureChannel
from groundstation.viewer.recording_file import RecordingFile, open_recording_file
from groundstation.viewer.reference_lines import (
    AxisErrors,
    ReferenceLine,
    ReferenceTracks,
    log_errors,
    log_reference_line,
)
from groundstation.viewer.scene import (
    RunwayOutline,
    fit_frustum,
    log_approach_styles,
    log_camera_styles,
    log_runway,
    log_station,
    log_styles,
    log_world,
    long_enough,
    outline_between,
)
from groundstation.viewer.track_channel import TrackChannel

__all__ = ["AxisErrors", "ImageFolder", "Media", "ReferenceLine", "ReferenceTracks", "RerunSink", "VideoAsset"]

APPLICATION = "groundstation"
# few large pieces: the file ends with a list of all of them, which is kept in memory until then
FLUSH_EPOCHS = 500


class RerunSink:
    """Writes step reports into a Rerun recording, in bulk, with flat memory.

    Parameters
    ----------
    path : the file to write, an old one is replaced; or an open stream, to be looked at as it goes on. The file has
        its name once it is whole, and is given up where the disk takes no more: `fault` says why.
    rig : the calibrated rig.
    session_name : the recording's title in the viewer.
    media : by station, the session's own videos or pictures, or that they come with the reports; a station without any
        shows its overlay alone.
    runway : the strip to draw; by default the one between the pedestals, as long as the track needs.
    live : use the operator's layout. flush_epochs : rows are sent after so many pairs.
    """

    def __init__(
        self,
        path: Path | rr.RecordingStream,
        rig: Rig,
        *,
        session_name: str,
        media: Mapping[str, Media] | None = None,
        runway: RunwayOutline | None = None,
        live: bool = False,
        flush_epochs: int = FLUSH_EPOCHS,
    ) -> None:
        self._live = live
        self._flush_epochs = flush_epochs
        self._rig = rig
        self._runway = runway if runway is not None else outline_between(rig)
        self._errors_against = ""
        self._notices: list[str] = []
        self._track = TrackChannel()
        self._approach: ApproachChannel | None = None
        self._file: RecordingFile | None = None
        if isinstance(path, Path):
            self._stream, self._file = _file_stream(path, session_name)
        else:
            self._stream = path
        self._send_blueprint(eye_before(rig), loop_s=None)
        media = media or {}
        self._pictures = {
            name: PictureChannel(name, m) if isinstance(m, ImageFolder) else PictureChannel(name, expected=m.expected)
            for name, m in media.items()
            if not isinstance(m, VideoAsset)
        }
        self._cameras = self._log_scene({name: m for name, m in media.items() if isinstance(m, VideoAsset)})

    @property
    def wants_pictures(self) -> bool:
        """Whether reports shall carry the pictures."""
        return any(channel.from_reports for channel in self._pictures.values())

    @property
    def fault(self) -> str | None:
        """Why the file was given up; None as long as it was not."""
        return None if self._file is None else self._file.fault

    def give_up(self, reason: str) -> bool:
        """Delete what is written of the file, to free its space; returns False if there is none to delete."""
        if self._file is None or self._file.fault is not None:
            return False
        self._file.give_up(reason)
        return True

    def discard(self) -> None:
        """Delete what is written of the file, unless it is closed."""
        if self._file is not None:
            self._file.discard()

    def write(self, report: StepReport) -> None:
        """Take one step's report; rows reach the file each `FLUSH_EPOCHS` pairs."""
        if self.fault is not None:
            return
        for camera in report.cameras:
            self._cameras[camera.station].add(camera)
            self._take_picture(camera)
            if self._notices:
                self._note(camera.t_s, self._notices)
                self._notices = []
        for estimate in report.estimates:
            self._track.add_estimate(estimate)
        for state in report.states:
            self._track.add_state(state)
        for event in report.events:
            self._track.add_event(event)
        most = self._flush_epochs
        if len(self._track) >= most or any(len(c) >= 2 * most for c in self._cameras.values()):
            self._flush()

    def write_approach(self, row: ApproachRow, runway: LandingRunway) -> None:
        """Take what is known of an approach to a runway."""
        if self.fault is not None:
            return
        if self._approach is None:
            self._approach = ApproachChannel(runway)
            log_approach_styles(self._stream)
            if self._live:
                self._send_blueprint(eye_before(self._rig), loop_s=None)
        self._approach.add(row)
        if self._live:
            # an advice that silence has changed does not wait for estimates
            self._send(self._approach.take())

    def write_reference(self, reference: ReferenceTracks) -> None:
        """Add the results of the evaluation; call it after the last `write` and before `close`."""
        for line in reference.lines:
            log_reference_line(self._stream, line)
        if reference.errors is not None:
            log_errors(self._stream, reference.errors)
            self._errors_against = reference.errors.against

    def close(self) -> None:
        """Write what is left, fit the opening view to the track, and finish the file."""
        if self.fault is None:
            self._finish()
        if self._file is not None:
            self._file.close()
        else:
            self._stream.flush()
            self._stream.disconnect()

    def _finish(self) -> None:
        self._flush()
        track = self._track
        if track.first_t_s is not None and track.last_t_s is not None:
            beyond = {c.station: c.frames_beyond_video for c in self._cameras.values() if c.frames_beyond_video}
            self._note(track.last_t_s, [f"{name}: {n} frames are not in the video" for name, n in beyond.items()])
            self._flush()
            log_runway(self._stream, long_enough(self._runway, float(track.upper_m[1])))
            for station in self._rig.stations:
                fit_frustum(self._stream, station, track.lower_m, track.upper_m)
            eye = eye_over(self._rig, track.lower_m, track.upper_m)
            self._send_blueprint(eye, loop_s=(track.first_t_s, track.last_t_s))

    def _note(self, t_s: float, texts: Iterable[str]) -> None:
        """Say something about the recording itself in its own log."""
        for text in texts:
            self._track.add_event(TrackEvent(t_s=t_s, level="warning", text=text))

    def _take_picture(self, camera: CameraReport) -> None:
        """Take a frame of an image folder as it lies on disk, or what comes with the report."""
        channel = self._pictures.get(camera.station)
        if channel is None:
            return
        channel.add(camera)
        self._notices += channel.notices
        channel.notices = []
        if channel.full:
            self._send(channel.take())

    def _flush(self) -> None:
        """Send all collected rows."""
        self._send([batch for camera in self._cameras.values() for batch in camera.take()])
        self._send([batch for channel in self._pictures.values() for batch in channel.take()])
        self._send(self._track.take())
        if self._approach is not None:
            self._send(self._approach.take())

    def _send(self, batches: Iterable[ColumnBatch]) -> None:
        for batch in batches:
            batch.send(self._stream)

    def _send_blueprint(self, eye: Viewpoint, loop_s: tuple[float, float] | None) -> None:
        """Send the layout, looping over a part of the session if given."""
        layout = (
            live_blueprint(self._rig, eye, approach=self._approach is not None)
            if self._live
            else blueprint(
                self._rig,
                eye=eye,
                loop_s=loop_s,
                errors_against=self._errors_against,
                approach=self._approach is not None,
            )
        )
        self._stream.send_blueprint(layout)

    def _log_scene(self, videos: Mapping[str, VideoAsset]) -> dict[str, CameraChannel]:
        """Log everything that stands still, and return a channel for each station."""
        log_world(self._stream)
        log_runway(self._stream, self._runway)
        log_styles(self._stream)
        middle_m = np.mean([s.ptu_position_m for s in self._rig.stations], axis=0)
        channels = {}
        for number, station in enumerate(self._rig.stations):
            log_station(self._stream, station, number, middle_m)
            log_camera_styles(self._stream, station, number)
            asset = videos.get(station.name)
            video = EmbeddedVideo() if asset is None else self._log_video(station.name, asset)
            numbers = None if asset is None else asset.frame_numbers
            channels[station.name] = CameraChannel(station.geometry(), video, numbers)
        return channels

    def _log_video(self, station: str, video: VideoAsset) -> EmbeddedVideo:
        """Embed a video; returns an empty one where its pictures come one by one, or not."""
        try:
            return log_video(self._stream, entity_paths.image(station), video)
        except SessionError as fault:
            try:
                count = VideoFile(video.path).count
            except InputError:
                self._notices.append(f"no pictures of {station}: {fault}")
            else:
                self._pictures[station] = PictureChannel(station, expected=count or 0)
        return EmbeddedVideo()


def _file_stream(path: Path, session_name: str) -> tuple[rr.RecordingStream, RecordingFile]:
    """Open the file; session time is its only timeline, so the wall clock stays out of it."""
    stream = rr.RecordingStream(APPLICATION, send_properties=False)
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    file = open_recording_file(path, stream)
    stream.send_recording_name(session_name)
    return stream, file
