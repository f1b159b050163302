"""The GigE camera of viva-genicam for tests, losing the given packets; prints JSON."""

import json
import time
from typing import Any

from viva_genicam.testing import FakeGigeCamera

from groundstation.sources.cameras.camera import CameraEvent, CameraFrame, CameraSettings
from groundstation.sources.cameras.open_camera import open_camera

LOST = [(4, 2), (7, 3), (7, 4), (9, 5)]


def delivered(resend: bool) -> dict[str, Any]:
    """Read 14 frames of a camera that loses packets in three of them, and can or cannot send them again."""
    events: list[CameraEvent] = []
    frames: list[CameraFrame] = []
    with FakeGigeCamera(640, 480, 20, pixel_format="BayerRG8", packet_resend=resend, drop_packets=LOST):
        url = "gige:127.0.0.1?packet=1400"
        with open_camera(url, CameraSettings(), clock=time.monotonic, on_event=events.append) as camera:
            end_s = time.monotonic() + 20.0
            while time.monotonic() < end_s and (not frames or frames[-1].index < 14):
                frame = camera.read(0.2)
                if frame is not None:
                    frames.append(frame)
            counts, found = camera.counts, camera.read_back
    return {
        "frames": len(frames),
        "counts": {"incomplete": counts.incomplete, "lost": counts.lost, "dropped": counts.dropped},
        "device_clock": found is not None and found.device_clock,
        "pattern": None if found is None else found.pixel_format,
    }


if __name__ == "__main__":
    print(json.dumps({"resent": delivered(True), "not resent": delivered(False)}))
