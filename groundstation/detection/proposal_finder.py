"""The proposal network: places in a whole picture that may show an aircraft, for the learned channel to look at.

It is a small fully convolutional network in the manner of a region proposal network: for each cell of 8 px it gives how
likely the middle of an aircraft of 8 to 26 px is there, where in the cell, and how wide it is. Wider aircraft are found
in the picture reduced to a half, a quarter, and so on. It is made for recall: what it proposes is confirmed or dropped
by the learned channel, which looks at each place in finer detail. It is trained by `training/proposal_fit.py`.
"""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import cv2
import numpy as np

from groundstation.arrays import Float32Array, FloatArray, ImageArray
from groundstation.errors import InputError

if TYPE_CHECKING:
    from onnxruntime import InferenceSession

CELL_PX = 8
# width of a target at which the network's logarithm of it is zero, and the widths that it learned
MIDDLE_WIDTH_PX, WIDTHS_PX = 14.0, (8.0, 26.0)
# aircraft, other flying things, binary logarithm of width / middle width, where in the cell, x and y
OUTPUTS = 5
# pictures are multiples of this
_MULTIPLE_PX = 16
# the smallest picture of the pyramid, shorter side
_LEAST_SIDE_PX = 48
# a part of the pyramid has at most so many pixels, and parts of a picture overlap by so many rows to each side: what
# the network's cells see
_PART_PIXELS, _OVERLAP_PX = 420_000, 40
# what stands out is measured against the mean and the spread of so many px around it
_AROUND_PX, _REDUCTION = 36, 4
_LEAST_SPREAD = 2.0
_LEVELS, _COLOURS, _MOST = 24.0, 16.0, 6.0
# proposals nearer to each other than this share of the wider one are of one aircraft, unless that is so much wider
_APART, _WIDER = 0.4, 2.0
_WANTED = f"an ONNX network from pictures (1, 3, h, w) to maps (1, {OUTPUTS}, h/{CELL_PX}, w/{CELL_PX})"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Proposal:
    """A place (2,) px that may show an aircraft ``width_px`` wide, and the network's log odds of it."""

    centre_px: FloatArray
    width_px: float
    odds: float


@dataclass(frozen=True, slots=True, kw_only=True)
class _PyramidPart:
    """Rows ``from_row`` to ``to_row`` of a picture reduced by ``reduction``, which belong to no other part."""

    reduction: int
    from_row: int
    to_row: int


class ProposalFinder:
    """Proposes places in the pictures of one camera.

    A whole picture is looked at in parts, of about equal effort: `count` of them.

    Parameters
    ----------
    weights : content of an ONNX file.
    image_size_px : (w, h) of the pictures.

    Raises `InputError` where the weights are no such network.
    """

    def __init__(self, weights: bytes, image_size_px: tuple[int, int]) -> None:
        self._weights, self._size = weights, image_size_px
        self._network = _network(weights)
        self._parts = parts_of(image_size_px)

    def __reduce__(self) -> tuple[type["ProposalFinder"], tuple[bytes, tuple[int, int]]]:
        # a session of ONNX Runtime cannot be copied
        return ProposalFinder, (self._weights, self._size)

    @property
    def count(self) -> int:
        """Number of parts of a whole picture."""
        return len(self._parts)

    def proposals(self, image: ImageArray, parts: range, most: int) -> list[Proposal]:
        """Return at most so many proposals of some parts of a picture (h, w, 3) BGR, the likeliest first."""
        found: list[Proposal] = []
        for number in parts:
            for part in self._parts[number % len(self._parts)]:
                found += self._in_part(image, part)
        return _apart(found, most)

    def _in_part(self, image: ImageArray, part: _PyramidPart) -> Iterator[Proposal]:
        """Yield the local maxima of a part."""
        low = max(part.from_row - _OVERLAP_PX, 0)
        rows = image[low * part.reduction : (part.to_row + _OVERLAP_PX) * part.reduction]
        size = max(rows.shape[1] // part.reduction, 1), max(rows.shape[0] // part.reduction, 1)
        ratio = np.array(rows.shape[1::-1]) / np.array(size)
        if part.reduction > 1:
            rows = np.asarray(cv2.resize(rows, size, interpolation=cv2.INTER_AREA), np.uint8)
        room = _room_for(rows.shape[0], rows.shape[1])
        network_input(rows, room[0, :, : rows.shape[0], : rows.shape[1]])
        maps = _maps_of(self._network, room)
        odds = maps[0]
        peaks = (odds >= cv2.dilate(odds, np.ones((3, 3), np.uint8))) & (odds > _LEAST_ODDS)
        cells_y, cells_x = np.nonzero(peaks)
        places = (np.stack([cells_x, cells_y]) + 0.5 + maps[3:, cells_y, cells_x]) * CELL_PX
        rows_v = places[1] + low
        inside = (part.from_row <= rows_v) & (rows_v < part.to_row) & (places[0] >= 0.0) & (places[0] < size[0])
        order = np.flatnonzero(inside)
        order = order[np.argsort(-odds[cells_y[order], cells_x[order]], kind="stable")][:_MOST_PEAKS]
        widths = MIDDLE_WIDTH_PX * 2.0 ** np.clip(maps[2, cells_y, cells_x], *_LOG_WIDTHS)
        for k in order:
            yield Proposal(
                centre_px=ratio * np.array([places[0, k], rows_v[k]]) - 0.5,
                width_px=float(widths[k] * ratio[0]),
                odds=float(odds[cells_y[k], cells_x[k]]),
            )


# below, a cell is not worth a look; and so many of a part are
_LEAST_ODDS, _MOST_PEAKS = -6.0, 32
_LOG_WIDTHS = math.log2(WIDTHS_PX[0] / MIDDLE_WIDTH_PX), math.log2(WIDTHS_PX[1] / MIDDLE_WIDTH_PX)


def parts_of(image_size_px: tuple[int, int]) -> list[list[_PyramidPart]]:
    """Return groups of parts of the pyramid of a picture (w, h), of about equal effort."""
    w, h = image_size_px
    groups: list[list[_PyramidPart]] = []
    strips = max(math.ceil(w * h / _PART_PIXELS), 1)
    edges = np.linspace(0, h, strips + 1).astype(int)
    groups += [[_PyramidPart(reduction=1, from_row=int(a), to_row=int(b))] for a, b in itertools.pairwise(edges)]
    left, reduction = float(_PART_PIXELS), 2
    rest: list[list[_PyramidPart]] = [[]]
    while min(w, h) // reduction >= _LEAST_SIDE_PX:
        pixels = (w // reduction) * (h // reduction)
        if pixels > left and rest[-1]:
            rest.append([])
            left = float(_PART_PIXELS)
        rest[-1].append(_PyramidPart(reduction=reduction, from_row=0, to_row=h // reduction + 1))
        left -= pixels
        reduction *= 2
    return [*groups, *(group for group in rest if group)]


def network_input(image: ImageArray, planes: Float32Array | None = None) -> Float32Array:
    """Return what the network sees of a picture (h, w, 3) BGR: (3, h, w), in ``planes`` if these are given.

    The level less the mean around it, in spreads around it and in levels, and blue less red less the mean around it.
    Exposure and haze that change slowly over the picture do not matter.
    """
    h, w = image.shape[:2]
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY).astype(np.float32)
    blue, red = (cv2.extractChannel(image, k) for k in (0, 2))
    colour: Float32Array = np.asarray(cv2.subtract(blue, red, dtype=cv2.CV_32F), np.float32)
    # in place: each array of a whole picture costs more to allocate than to fill
    around = np.multiply(grey, grey)
    mean, square, tint = (_around(plane) for plane in (grey, around, colour))
    sharpness = np.asarray(1.0 / np.sqrt(np.maximum(square - mean * mean, 0.0) + _LEAST_SPREAD**2), np.float32)
    grey -= _enlarged(mean, around)
    colour -= _enlarged(tint, around)
    planes = np.empty((3, h, w), np.float32) if planes is None else planes
    np.multiply(grey, _enlarged(sharpness, around), out=planes[0])
    np.multiply(grey, 1.0 / _LEVELS, out=planes[1])
    np.multiply(colour, 1.0 / _COLOURS, out=planes[2])
    return np.clip(planes, -_MOST, _MOST, out=planes)


def _around(plane: Float32Array) -> Float32Array:
    """Return the mean around each place of a plane (h, w), reduced."""
    h, w = plane.shape
    size = max(w // _REDUCTION, 1), max(h // _REDUCTION, 1)
    side = _AROUND_PX // _REDUCTION
    small = cv2.resize(plane, size, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.blur(small, (side, side), borderType=cv2.BORDER_REFLECT), np.float32)


def _enlarged(plane: Float32Array, out: Float32Array) -> Float32Array:
    return np.asarray(cv2.resize(plane, out.shape[1::-1], dst=out, interpolation=cv2.INTER_LINEAR), np.float32)


def _apart(found: list[Proposal], most: int) -> list[Proposal]:
    """Return the likeliest proposals, one of each aircraft."""
    chosen: list[Proposal] = []
    for each in sorted(found, key=lambda p: -p.odds):
        if not any(_are_one(each, other) for other in chosen):
            chosen.append(each)
            if len(chosen) == most:
                break
    return chosen


def _are_one(a: Proposal, b: Proposal) -> bool:
    wider, narrower = max(a.width_px, b.width_px), min(a.width_px, b.width_px)
    return math.dist(a.centre_px, b.centre_px) <= _APART * wider and wider <= _WIDER * narrower


@lru_cache(maxsize=2)
def _network(weights: bytes) -> "InferenceSession":
    """Return a session of ONNX Runtime, which all cameras of a process share."""
    # a quarter of a second to import, which only those pay who use it
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 4
    try:
        network = onnxruntime.InferenceSession(weights, options, providers=["CPUExecutionProvider"])
        shape = _run(network, np.zeros((3, 64, 96), np.float32)).shape
    except Exception as fault:
        # its own exceptions have no common class but this
        raise InputError(
            "weights of the proposal network", got="a file that ONNX Runtime cannot run", wanted=_WANTED
        ) from fault
    if shape != (OUTPUTS, 64 // CELL_PX, 96 // CELL_PX):
        raise InputError("weights of the proposal network", got=f"maps of shape {shape}", wanted=_WANTED)
    return network


def _run(network: "InferenceSession", planes: Float32Array) -> Float32Array:
    """Return a network's maps (5, h / 8, w / 8) of a picture's planes (3, h, w)."""
    h, w = planes.shape[1:]
    room = _room_for(h, w)
    room[0, :, :h, :w] = planes
    return _maps_of(network, room)


def _room_for(h: int, w: int) -> Float32Array:
    """Return room for planes (3, h, w) of a size that the network takes, (1, 3, …); it is zero beyond them."""
    room = np.empty((1, 3, -(-h // _MULTIPLE_PX) * _MULTIPLE_PX, -(-w // _MULTIPLE_PX) * _MULTIPLE_PX), np.float32)
    room[:, :, h:] = 0.0
    room[:, :, :, w:] = 0.0
    return room


def _maps_of(network: "InferenceSession", room: Float32Array) -> Float32Array:
    return np.asarray(network.run(None, {network.get_inputs()[0].name: room})[0][0], np.float32)
