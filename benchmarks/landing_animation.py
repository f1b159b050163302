"""The animation on the first screen of the README: the bundled landing as it is tracked.

    python benchmarks/landing_animation.py [docs/images/landing.gif]

Above, what each camera sees around the aircraft, with the outline found; below, the approach from the side and from
above: the track with two sigmas, and the exact trajectory. Replays recordings/landing-1 (half a minute), writes a GIF.
"""

import sys
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from groundstation.arrays import FloatArray, ImageArray
from groundstation.messages import CameraReport, Detection, Kinematics, TrackStatus
from groundstation.session import load_session, load_truth
from groundstation.sources.session_source import session_source
from groundstation.tracking.config import Config
from groundstation.tracking.pipeline import Pipeline

ROOT = Path(__file__).resolve().parent.parent
SESSION = ROOT / "recordings" / "landing-1"
OUT = ROOT / "docs" / "images" / "landing.gif"
# of the GIF: size, px; every so many pairs; time of a picture, ms; colours
VIEW_W, VIEW_H, GAP, PLOT_H = 356, 200, 8, 150
EVERY, FRAME_MS, COLOURS = 4, 160, 96
CROP_W = 240
FROM_S, TO_S = 2.0, 32.0
FAR_M, NEAR_M, HIGH_M, WIDE_M = 520.0, 90.0, 45.0, 8.0
BACK, TEXT, GRID, TRACK, TRUTH, OUTLINE = "#14181d", "#e8ecf0", "#3a424c", "#ffb454", "#6fc3ff", (60, 20, 225)


@dataclass(frozen=True, kw_only=True)
class Moment:
    """One pair: both views, and the estimate if there is one."""

    t_s: float
    views: tuple[ImageArray, ...]
    status: TrackStatus
    kinematics: Kinematics | None


def crop(report: CameraReport) -> ImageArray:
    """Return what a camera sees around its target, (VIEW_H, VIEW_W, 3) RGB, with the outline."""
    assert report.image is not None
    picture = report.image.preview()
    h, w = picture.shape[:2]
    found = report.result if isinstance(report.result, Detection) else None
    middle = np.array([0.5 * w, 0.5 * h]) if found is None else found.centroid_px
    half_w, half_h = CROP_W // 2, round(0.5 * CROP_W * VIEW_H / VIEW_W)
    x = int(np.clip(middle[0], half_w, w - half_w)) - half_w
    y = int(np.clip(middle[1], half_h, h - half_h)) - half_h
    scale = VIEW_W / (2 * half_w)
    part = cv2.resize(picture[y : y + 2 * half_h, x : x + 2 * half_w], (VIEW_W, VIEW_H), interpolation=cv2.INTER_CUBIC)
    if found is not None:
        gaps = np.flatnonzero(np.isnan(found.contour_px[:, 0]))
        for piece in np.split(found.contour_px, gaps):
            points = (piece[~np.isnan(piece[:, 0])] - (x, y) + 0.5) * scale
            if len(points):
                cv2.polylines(part, [np.round(16.0 * points).astype(np.int32)], True, OUTLINE, 1, cv2.LINE_AA, 4)
    return np.asarray(cv2.cvtColor(part, cv2.COLOR_BGR2RGB), np.uint8)


def moments() -> tuple[list[Moment], FloatArray]:
    """Return the pairs of the landing as they are tracked, and the exact positions (n, 3)."""
    session = load_session(SESSION)
    pipeline = Pipeline(session.rig, Config(), span_m=session.target.span_m, initial=session.initial, keep_images=True)
    found, views = [], dict[str, ImageArray]()
    with session_source(session, None, TO_S) as source:
        for event in source:
            report = pipeline.step(event)
            for camera in report.cameras:
                views[camera.station] = crop(camera)
            for estimate in report.estimates:
                both = tuple(views[name] for name in session.rig.names if name in views)
                if estimate.t_s >= FROM_S and len(both) == len(session.rig.names):
                    found.append(
                        Moment(t_s=estimate.t_s, views=both, status=estimate.status, kinematics=estimate.kinematics)
                    )
    truth = load_truth(session, lambda fault: None)
    assert truth is not None
    return found, truth.position_runway_m


def place(y_m: float, value: float, least: float, most: float, top: int) -> tuple[float, float]:
    """Return the pixel of a distance along the runway and of a height or an offset, in the plot below ``top``."""
    width = 2 * VIEW_W + GAP
    u = 40 + (width - 60) * (FAR_M - y_m) / (FAR_M - NEAR_M)
    return u, top + 12 + (PLOT_H - 34) * (most - value) / (most - least)


def draw_plot(
    canvas: ImageDraw.ImageDraw,
    top: int,
    past: list[Kinematics],
    truth: FloatArray,
    axis: int,
    words: str,
    span: tuple[float, float],
) -> None:
    """Draw one projection of the approach: the exact trajectory, the track so far, and two sigmas of it."""
    font = ImageFont.load_default(size=11)
    for line_m in range(100, 501, 100):
        u, v = place(line_m, span[0], *span, top)
        canvas.line([(u, top + 12), (u, v)], fill=GRID)
        canvas.text((u - 12, v + 4), f"{line_m} m", fill=TEXT, font=font)
    canvas.text((6, top - 2), words, fill=TEXT, font=font)
    exact = [place(float(p[1]), float(p[axis]), *span, top) for p in truth if NEAR_M < p[1] < FAR_M]
    canvas.line(exact, fill=TRUTH, width=1)
    for k in past:
        sigma = 2.0 * float(np.sqrt(k.covariance[axis, axis]))
        y_m, value = float(k.position_runway_m[1]), float(k.position_runway_m[axis])
        low, high = place(y_m, value - sigma, *span, top), place(y_m, value + sigma, *span, top)
        canvas.line([low, high], fill="#7a5a2c")
    points = [place(float(k.position_runway_m[1]), float(k.position_runway_m[axis]), *span, top) for k in past]
    if len(points) > 1:
        canvas.line(points, fill=TRACK, width=2)


def picture(moment: Moment, past: list[Kinematics], truth: FloatArray) -> Image.Image:
    """Return one picture of the animation."""
    width, height = 2 * VIEW_W + GAP, VIEW_H + 24 + 2 * PLOT_H
    image = Image.new("RGB", (width, height), BACK)
    for k, view in enumerate(moment.views):
        image.paste(Image.fromarray(view), (k * (VIEW_W + GAP), 0))
    canvas = ImageDraw.Draw(image)
    line = f"{moment.t_s:5.1f} s   {moment.status.value}"
    if moment.kinematics is not None:
        x, y, z = moment.kinematics.position_runway_m
        sx, sy, sz = np.sqrt(np.diag(moment.kinematics.covariance)[:3])
        line += f"   x {x:+.2f} ± {sx:.2f}   y {y:.1f} ± {sy:.1f}   z {z:.2f} ± {sz:.2f} m"
    canvas.text((6, VIEW_H + 4), line, fill=TEXT, font=ImageFont.load_default(size=13))
    draw_plot(
        canvas,
        VIEW_H + 28,
        past,
        truth,
        2,
        "height up to 45 m: track with 2 sigmas (orange), exact trajectory (blue)",
        (0.0, HIGH_M),
    )
    draw_plot(
        canvas,
        VIEW_H + 28 + PLOT_H,
        past,
        truth,
        0,
        "from above, 8 m to either side of the centre line",
        (-WIDE_M, WIDE_M),
    )
    return image


def main(out: Path) -> None:
    """Write the animation."""
    pairs, truth = moments()
    past: list[Kinematics] = []
    pictures = []
    for number, moment in enumerate(pairs):
        if moment.kinematics is not None:
            past.append(moment.kinematics)
        if number % EVERY == 0:
            pictures.append(picture(moment, past, truth))
    palette = pictures[len(pictures) // 2].quantize(COLOURS, Image.Quantize.MEDIANCUT)
    frames = [p.quantize(COLOURS, palette=palette, dither=Image.Dither.NONE) for p in pictures]
    frames[0].save(out, save_all=True, append_images=frames[1:], duration=FRAME_MS, loop=0, optimize=True)
    print(f"wrote {out}: {len(frames)} pictures, {out.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else OUT)
