"""The operator's screen in Rerun while the station is in operation: pictures, track, words, log.

A separate thread draws; `write` never blocks, and if drawing is too slow, the oldest reports are left
out and counted. Pictures are shown a few times a second and reduced: what the pipeline sees is in the recording.
"""

import contextlib
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
import rerun as rr

from groundstation.integrity.approach_advice import ApproachAdvice
from groundstation.landing.glide_path import ApproachDeviations
from groundstation.landing.touchdown import TouchdownForecast
from groundstation.landing_site.runway import LandingRunway
from groundstation.messages import CameraReport, StepReport
from groundstation.rig.rig import Rig
from groundstation.thread_scheduling import give_way
from groundstation.viewer import entity_paths
from groundstation.viewer.approach_row import ApproachRow
from groundstation.viewer.picture_channel import jpeg_image
from groundstation.viewer.rerun_sink import RerunSink

_PICTURE_EVERY_S = 0.2
_APPROACH_EVERY_S = 0.1
_MOST_WAITING = 300
_FLUSH_EPOCHS = 3
# a warning is shown if the status is older than this
_SILENT_S = 2.0
_LOOK_EVERY_S = 0.5


class LiveView:
    """A sink of reports and of the station's status.

    Parameters
    ----------
    stream : where to send it; it is closed at the end.
    name : the recording's title.
    clock : monotonic, s, to tell how old a status is.
    """

    def __init__(
        self, stream: rr.RecordingStream, rig: Rig, name: str, clock: Callable[[], float] = time.monotonic
    ) -> None:
        stream.send_recording_name(name)
        self.left_out = 0
        self._stream = stream
        self._sink = RerunSink(stream, rig, session_name=name, live=True, flush_epochs=_FLUSH_EPOCHS)
        self._shown_s: dict[str, float] = {}
        self._waiting: deque[Callable[[], None]] = deque()
        self._approach_shown: tuple[float, object] = (-np.inf, None)
        self._changed = threading.Condition()
        self._closed = False
        self._clock = clock
        # session time of the newest status, and when it came by the clock
        self._newest_status: tuple[float, float] | None = None
        self._thread = threading.Thread(target=self._work, name="rerun", daemon=True)
        self._thread.start()

    def write(self, report: StepReport) -> None:
        """Queue one report; does not block."""
        self._put(partial(self._draw, report))

    def show_status(self, t_s: float, lines: Sequence[str]) -> None:
        """Queue the status lines for the operator; does not block."""
        self._newest_status = (t_s, self._clock())
        self._put(partial(self._log_status, t_s, tuple(lines)))

    def show_approach(
        self,
        t_s: float,
        advice: ApproachAdvice | None,
        deviations: ApproachDeviations | None,
        touchdown: TouchdownForecast | None,
        runway: LandingRunway,
    ) -> None:
        """Queue what is known of an approach, ten times a second and at each change of advice; does not block."""
        shown_s, told = self._approach_shown
        level = None if advice is None else advice.level
        if level == told and 0.0 <= t_s - shown_s < _APPROACH_EVERY_S:
            return
        self._approach_shown = (t_s, level)
        row = ApproachRow(t_s=t_s, advice=advice, deviations=deviations, touchdown=touchdown)
        self._put(partial(self._sink.write_approach, row, runway))

    def status_text(self) -> str:
        """Return the status line of the screen itself; "" if no report was skipped."""
        return f"screen: {self.left_out} reports not drawn, it is too slow" if self.left_out else ""

    def close(self, within_s: float = 5.0) -> None:
        """Draw the queued reports and close the stream; gives up after ``within_s``."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._thread.join(within_s)

    def _put(self, draw: Callable[[], None]) -> None:
        with self._changed:
            if len(self._waiting) >= _MOST_WAITING:
                self._waiting.popleft()
                self.left_out += 1
            self._waiting.append(draw)
            self._changed.notify()

    # ------------------------------------------------------------------------------------ the thread
    def _work(self) -> None:
        give_way()
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting or self._closed, _LOOK_EVERY_S)
                if self._closed and not self._waiting:
                    break
                draw = self._waiting.popleft() if self._waiting else self._check_age
            draw()
        # a viewer that has ended takes no more: what it would have drawn last is lost with it
        with contextlib.suppress(RuntimeError):
            self._sink.close()

    def _log_status(self, t_s: float, lines: Sequence[str]) -> None:
        self._stream.set_time(entity_paths.TIMELINE, duration=np.timedelta64(round(t_s * 1e9), "ns"))
        text = "\n".join([f"**{lines[0]}**", "", *(f"- {line}" for line in lines[1:])])
        self._stream.log(entity_paths.WORDS, rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN))

    def _check_age(self) -> None:
        """Log a warning if no status has arrived for long, as when its sender hangs."""
        if self._newest_status is None:
            return
        t_s, came_s = self._newest_status
        age_s = self._clock() - came_s
        if age_s > _SILENT_S:
            self._log_status(t_s + age_s, [f"NO STATUS for {age_s:.0f} s: what is shown is old"])

    def _draw(self, report: StepReport) -> None:
        for camera in report.cameras:
            self._show(camera)
        self._sink.write(report)

    def _show(self, camera: CameraReport) -> None:
        """Log a picture at a limited rate; overlays are logged at every report."""
        last_s = self._shown_s.get(camera.station, -np.inf)
        if camera.image is None or 0.0 <= camera.t_s - last_s < _PICTURE_EVERY_S:
            return
        self._shown_s[camera.station] = camera.t_s
        picture = camera.image.preview()
        self._stream.set_time(entity_paths.TIMELINE, duration=np.timedelta64(round(camera.t_s * 1e9), "ns"))
        self._stream.log(entity_paths.image(camera.station), jpeg_image(picture))
