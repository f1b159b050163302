"""Baselines of the tracker: the Hough transform on Canny's edges, and graph cuts (OpenCV's GrabCut).

Both use one picture alone, between the same rows as the tracker. Neither gets the edges' positions; GrabCut
gets the trapezoid in which to cut, because it needs seeds.
"""

import math

import cv2
import numpy as np

from groundstation.arrays import FloatArray, ImageArray

# of the strongest gradient, as in the paper's Fig. 1
_CANNY = (0.1, 0.4)
_STRONGEST = 12
_ROUNDS = 3
_LEAST_ROWS = 6


def hough_edges(
    image: ImageArray, rows_px: FloatArray, half_angle_rad: float = math.radians(75.0)
) -> FloatArray | None:
    """Return the crossings (4,) of the strongest pair of Hough lines on Canny's edges, None without one.

    Lines within ``half_angle_rad`` of the vertical count. A pair is two lines that do not cross between the rows and
    converge upwards; of these the one with the most votes is used, lines sorted by votes as in OpenCV.
    """
    first, last = int(rows_px[0]), int(rows_px[1]) + 1
    grey = cv2.cvtColor(image[first:last], cv2.COLOR_BGR2GRAY)
    smooth = cv2.GaussianBlur(grey, (0, 0), 1.0)
    dx, dy = (cv2.Sobel(smooth, cv2.CV_16S, *order) for order in ((1, 0), (0, 1)))
    strongest = float(np.max(np.abs(dx.astype(np.float64)) + np.abs(dy)))
    if strongest == 0.0:
        return None
    edges = cv2.Canny(dx, dy, _CANNY[0] * strongest, _CANNY[1] * strongest)
    lines = cv2.HoughLines(edges, 1.0, math.radians(1.0), max(int(0.25 * (last - first)), 5))
    if lines is None:
        return None
    found: list[FloatArray] = []
    for rho, theta in lines[:, 0, :2]:
        off = (theta + 0.5 * math.pi) % math.pi - 0.5 * math.pi
        if abs(off) > half_angle_rad:
            continue
        ends = (rho - (rows_px - first) * math.sin(theta)) / math.cos(theta)
        if all(np.abs(ends - other).max() > 4.0 for other in found):
            found.append(ends)
        if len(found) == _STRONGEST:
            break
    for j in range(1, len(found)):
        for i in range(j):
            left, right = sorted((found[i], found[j]), key=lambda ends: float(ends.sum()))
            widths = right - left
            if widths[0] > 1.0 and widths[1] > widths[0]:
                return np.concatenate([left, right])
    return None


def graph_cut_edges(
    image: ImageArray, rows_px: FloatArray, guess_px: FloatArray, widths_px: FloatArray
) -> FloatArray | None:
    """Return crossings (4,) of lines through the borders of GrabCut's foreground, None where it finds none.

    Seeds: the inner half of the given trapezoid (4,) is certain foreground, the area farther off than ``widths_px``
    (2, 2; at the upper and lower row of both lines) certain background, and the rest is cut.
    """
    first, last = int(np.ceil(rows_px[0])), int(np.floor(rows_px[1])) + 1
    rows = np.arange(first, last)
    t = ((rows - rows_px[0]) / (rows_px[1] - rows_px[0]))[:, None]
    left, right = (guess_px[k] * (1 - t) + guess_px[k + 1] * t for k in (0, 2))
    reach_left, reach_right = (2.0 * (widths_px[k, 0] * (1 - t) + widths_px[k, 1] * t) for k in (0, 1))
    columns = np.arange(image.shape[1])[None, :]
    mask = np.full((last - first, image.shape[1]), cv2.GC_BGD, np.uint8)
    mask[(columns > left - reach_left) & (columns < right + reach_right)] = cv2.GC_PR_BGD
    mask[(columns > left) & (columns < right)] = cv2.GC_PR_FGD
    quarter = 0.25 * (right - left)
    mask[(columns > left + quarter) & (columns < right - quarter)] = cv2.GC_FGD
    if not (mask == cv2.GC_FGD).any():
        return None
    part = np.ascontiguousarray(image[first:last])
    models = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.grabCut(part, mask, (0, 0, 0, 0), *models, _ROUNDS, cv2.GC_INIT_WITH_MASK)
    inside = (mask == cv2.GC_FGD) | (mask == cv2.GC_PR_FGD)
    filled = inside.any(axis=1)
    if filled.sum() < _LEAST_ROWS:
        return None
    starts = inside.argmax(axis=1)[filled] - 0.5
    ends = image.shape[1] - inside[:, ::-1].argmax(axis=1)[filled] - 0.5
    sides = [np.polyval(np.polyfit(rows[filled], side, 1), rows_px) for side in (starts, ends)]
    return np.concatenate(sides)
