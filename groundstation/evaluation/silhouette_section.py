"""The report's section of the aircraft at a few ranges: parts of pictures with outline and reported point over them."""

import base64
from collections.abc import Iterator, Sequence
from html import escape

import cv2
import numpy as np

from groundstation.arrays import Float32Array
from groundstation.evaluation.silhouettes import Silhouette

# lossy, and nearly without loss for aircraft of a few pixels
_WEBP = [cv2.IMWRITE_WEBP_QUALITY, 90]
# corners of an outline in the page; a near aircraft's has some hundred more than can be seen
_MOST_CORNERS = 240
# pixel centres have integer coordinates, an SVG's pixel 0 starts at 0
_CORNER_FROM_CENTRE_PX = 0.5
_CROSS_OPEN, _CROSS = 0.02, 0.06
SILHOUETTE_CSS = """
.ranges{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,215px),1fr));gap:1rem}
.range{display:grid;gap:.5rem;align-content:start}.range h3{margin:0}
.range svg{width:100%;height:auto;display:block;background:#888;border-radius:4px}
.range path{fill:none;vector-effect:non-scaling-stroke;stroke-linejoin:round}
.range .edge{stroke:#fff;stroke-opacity:.75;stroke-width:3.4px}
.range .outline{stroke:#c1003c;stroke-width:1.5px}.range .point{stroke:#0057d9;stroke-width:1.7px}
@media screen and (max-width:600px){.range{grid-template-columns:1fr 1fr}.range h3{grid-column:1/-1}}
@media print{.ranges{grid-template-columns:repeat(5,1fr);gap:4mm}.range{break-inside:avoid}}
"""


def silhouette_section(pairs: Sequence[Sequence[Silhouette]], *, tracked: bool) -> str:
    """Return the section on pairs of pictures from far to near; one line where there are none.

    Nothing at all where no target was ``tracked``.
    """
    if not pairs:
        text = "No pictures: the session has none, or none of its silhouettes was used while the aircraft was tracked."
        return f"<h2>The aircraft</h2><p>{text}</p>" if tracked else ""
    shown = "".join(_range(pair) for pair in pairs)
    return (
        "<h2>The aircraft</h2><p>As the cameras saw it from far to near, each picture enlarged to the same width. Red: "
        f"the silhouette that was found; blue cross: the reported point, the nose.</p><div class='ranges'>{shown}</div>"
    )


def _range(pair: Sequence[Silhouette]) -> str:
    """Return the pictures of one pair below each other."""
    nearest_m = min(silhouette.range_m for silhouette in pair)
    heading = f"<h3>{nearest_m:.0f} m, {pair[0].t_s:.2f} s</h3>"
    return f"<div class='range'>{heading}{''.join(_picture(silhouette) for silhouette in pair)}</div>"


def _picture(s: Silhouette) -> str:
    """Return one picture with what was found over it."""
    box, part, kept = s.detection.box, s.part, s.kept
    size = f"{box.w:.0f} × {box.h:.0f} px"
    label = f"Camera {s.station} at {s.t_s:.2f} s: the aircraft at {s.range_m:.0f} m, {size}, with its outline"
    data = base64.b64encode(cv2.imencode(".webp", s.pixels, _WEBP)[1].tobytes()).decode("ascii")
    # few pixels are shown as they are; pictures that are reduced on the screen are smoothed
    look = " style='image-rendering:pixelated'" if part.w < 2 * s.pixels.shape[1] and part.w <= 200 else ""
    outline = "".join(_strokes(s.detection.contour_px))
    u, v = s.detection.u_px + _CORNER_FROM_CENTRE_PX, s.detection.v_px + _CORNER_FROM_CENTRE_PX
    cross = _cross(u, v, float(part.w))
    return (
        f"<figure><svg role='img' aria-label='{escape(label, quote=True)}' "
        f"viewBox='{part.x0} {part.y0} {part.w} {part.h}'>"
        f"<image x='{kept.x0}' y='{kept.y0}' width='{kept.w}' height='{kept.h}' preserveAspectRatio='none'{look} "
        f"href='data:image/webp;base64,{data}'/><path class='edge' d='{outline}'/><path class='outline' d='{outline}'/>"
        f"<path class='edge' d='{cross}'/><path class='point' d='{cross}'/></svg>"
        f"<figcaption>{escape(s.station)}: {s.range_m:.0f} m, {size}</figcaption></figure>"
    )


def _strokes(contour_px: Float32Array) -> Iterator[str]:
    """Yield the closed pieces of an outline (n, 2), which rows of NaN separate, as the data of an SVG path."""
    gaps = np.isnan(contour_px[:, 0])
    step = max(1, -(-len(contour_px) // _MOST_CORNERS))
    for piece in np.split(contour_px, np.flatnonzero(gaps)):
        corners = piece[~np.isnan(piece[:, 0])][::step] + _CORNER_FROM_CENTRE_PX
        if len(corners):
            yield "M" + "L".join(f"{u:.1f} {v:.1f}" for u, v in corners) + "Z"


def _cross(u: float, v: float, width: float) -> str:
    """Return a cross with an open centre about a point, its size a share of the picture's width."""
    inner, outer = _CROSS_OPEN * width, _CROSS * width
    ends = [(1, 0), (-1, 0), (0, 1), (0, -1)]
    return "".join(f"M{u + x * inner:.2f} {v + y * inner:.2f}L{u + x * outer:.2f} {v + y * outer:.2f}" for x, y in ends)
