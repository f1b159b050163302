"""CPU time of one core for a rendered picture, compared with decoding a frame of the same size.

    python benchmarks/renderer_speed.py

A landing is filmed at five ranges, each picture with angles of its own; the bundled landing's left video is decoded in
the same run, in turn, so that a busy machine slows both equally.
"""

import time
from pathlib import Path

import cv2
import numpy as np

from groundstation.geometry.aim import aim_at
from groundstation.rig.rig import load_rig
from groundstation.simulation.flights import FlightName, flight
from groundstation.simulation.rendered_camera import RenderedCamera
from groundstation.simulation.rendered_scene import RenderedScene

LANDING = Path(__file__).resolve().parent.parent / "recordings" / "landing-1"
RANGES_M = (500.0, 300.0, 150.0, 100.0, 86.0)
PICTURES = 40
STEP_S = 1.0 / 30.0


def render(camera: RenderedCamera, range_m: float, spent: list[float]) -> None:
    """Render pictures from a range on, each 1/30 s later; add the CPU time of each, s."""
    geometry = camera.station.geometry()
    span = camera.world.trajectory.span_s
    times = np.linspace(*span, 2000)
    first = float(times[np.argmin(np.abs(camera.world.trajectory.position(times)[:, 1] - range_m))])
    for k in range(PICTURES):
        t = first + k * STEP_S
        aim = aim_at(geometry, camera.world.aircraft_at(t).position_runway_m)
        assert aim is not None
        began = time.thread_time()
        camera.picture(t, aim.pan_rad, aim.tilt_rad, 0.02, 0.01)
        spent.append(time.thread_time() - began)


def decode(capture: cv2.VideoCapture, spent: list[float]) -> None:
    """Decode frames in one thread; add the CPU time of each, s."""
    for _ in range(PICTURES):
        # process time: FFmpeg may decode in a separate thread
        began = time.process_time()
        good, _ = capture.read()
        assert good, "the video is shorter than the benchmark"
        spent.append(time.process_time() - began)


def main() -> None:
    cv2.setNumThreads(1)
    began = time.thread_time()
    camera = RenderedCamera(
        RenderedScene(trajectory=flight(FlightName.LANDING)), load_rig(LANDING / "rig.toml")["left"]
    )
    print(f"surroundings of one station: {time.thread_time() - began:.1f} s of CPU")
    # the first picture compiles
    camera.picture(0.0, 0.0, 0.05, 1.0, 0.0)
    capture = cv2.VideoCapture(str(LANDING / "left.mp4"), cv2.CAP_FFMPEG, [cv2.CAP_PROP_N_THREADS, 1])
    decoded: list[float] = []
    rendered: list[float] = []
    print("nose at y, m    CPU per picture, ms: median   90 %")
    for range_m in RANGES_M:
        own: list[float] = []
        render(camera, range_m, own)
        decode(capture, decoded)
        rendered += own
        print(f"{range_m:9.0f} {1e3 * np.median(own):31.2f} {1e3 * np.quantile(own, 0.9):6.2f}")
    picture, frame = (1e3 * float(np.median(v)) for v in (rendered, decoded))
    print(f"picture {picture:.2f} ms, decoded frame {frame:.2f} ms (H.264 to BGR), ratio {picture / frame:.2f}")
    print(f"one core renders {1e3 / picture:.0f} pictures/s")


if __name__ == "__main__":
    main()
