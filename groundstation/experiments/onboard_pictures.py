"""Runway edges drawn over a picture: the runway cut out and enlarged, and the legend."""

from collections.abc import Sequence

import cv2
import numpy as np

from groundstation.arrays import FloatArray, ImageArray

Colour = tuple[int, int, int]
Drawn = tuple[Colour, FloatArray]

PANEL_PX = (420, 300)
_ROUND_PX = (24.0, 16.0)
_LEAST_PX = 96.0
_SHIFT = 4
_FONT, _SCALE = cv2.FONT_HERSHEY_SIMPLEX, 0.5
_LEGEND_PX = 28
_INK: Colour = (235, 235, 235)


def draw_line(picture: ImageArray, colour: Colour, crossings: FloatArray, rows: FloatArray) -> None:
    """Draw both edges (4,) into a picture."""
    for pair in np.clip(crossings, -2000.0, 3000.0).reshape(2, 2):
        ends = [(round(16 * float(u)), round(16 * float(v))) for u, v in zip(pair, rows, strict=True)]
        cv2.line(picture, ends[0], ends[1], colour, 1, cv2.LINE_AA, _SHIFT)


def panel(image: ImageArray, wanted: FloatArray, rows: FloatArray, drawn: Sequence[Drawn], words: str) -> ImageArray:
    """Return the runway of a picture, `PANEL_PX` large, BGR, with edges drawn in their colours.

    ``wanted`` (4,) px are the true crossings of the ``rows`` (2,), the centre of the cut-out; ``drawn`` are crossings
    of the same rows; ``words`` is the picture's title.
    """
    (left, top), scale = _cut(image, wanted, rows)
    w, h = PANEL_PX
    # cv2's pixels are whole at their centres
    move = np.array([[scale, 0.0, -scale * left], [0.0, scale, -scale * top]])
    cut = np.asarray(cv2.warpAffine(image, move, (w, h), flags=cv2.INTER_LINEAR), np.uint8)
    for colour, crossings in drawn:
        draw_line(cut, colour, scale * (crossings - left), scale * (rows - top))
    cv2.rectangle(cut, (0, h - 22), (w, h), (0, 0, 0), cv2.FILLED)
    cv2.putText(cut, words, (6, h - 7), _FONT, _SCALE, _INK, 1, cv2.LINE_AA)
    return cut


def _cut(image: ImageArray, wanted: FloatArray, rows: FloatArray) -> tuple[tuple[float, float], float]:
    """Return the upper left corner of the cut-out, px, and its enlargement."""
    height, width = image.shape[:2]
    least, most = np.array([wanted.min(), rows[0]]), np.array([wanted.max(), rows[1]])
    first = np.maximum(least - _ROUND_PX, 0.0)
    last = np.minimum(most + _ROUND_PX, [width - 1.0, height - 1.0])
    w, h = PANEL_PX
    across = min(max(float(last[0] - first[0]), float(last[1] - first[1]) * w / h, _LEAST_PX), float(width))
    size = np.array([across, across * h / w])
    corner = np.clip(0.5 * (first + last) - 0.5 * size, 0.0, np.maximum([width, height] - size, 0.0))
    return (float(corner[0]), float(corner[1])), w / across


def sheet(rows: Sequence[Sequence[ImageArray]], legend: Sequence[tuple[Colour, str]]) -> ImageArray:
    """Return panels side by side, row by row, under a legend of the colours; missing ones are black."""
    w, h = PANEL_PX
    across = max(len(row) for row in rows)
    nothing = np.zeros((h, w, 3), np.uint8)
    body = [np.hstack([*row, *[nothing] * (across - len(row))]) for row in rows]
    head = np.zeros((_LEGEND_PX, across * w, 3), np.uint8)
    at = 8
    for colour, name in legend:
        cv2.line(head, (at, _LEGEND_PX // 2), (at + 24, _LEGEND_PX // 2), colour, 2)
        cv2.putText(head, name, (at + 30, _LEGEND_PX // 2 + 5), _FONT, _SCALE, _INK, 1, cv2.LINE_AA)
        at += 30 + cv2.getTextSize(name, _FONT, _SCALE, 1)[0][0] + 22
    return np.vstack([head, *body])
