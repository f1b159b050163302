"""Axis-aligned boxes in an image: regions of interest, windows to read, bounding boxes of silhouettes."""

from typing import Generic, NamedTuple, TypeVar

Length = TypeVar("Length", int, float)


class Box(NamedTuple, Generic[Length]):
    """The columns x0 ≤ x < x1 and rows y0 ≤ y < y1 of an image, px, x to the right and y down.

    A box of integers holds whole pixels: the last column and row are ``x1 - 1`` and ``y1 - 1``. A box of floats is an
    area; pixel centres have integer coordinates, so that pixel k reaches from k − 0.5 to k + 0.5, unless the field that
    holds the box states that its coordinates count from the edge of pixel 0. Compiled kernels take boxes as they are.
    Files and the command line hold x, y, w, h.
    """

    x0: Length
    y0: Length
    x1: Length
    y1: Length

    @property
    def w(self) -> Length:
        """Its width, px."""
        return self.x1 - self.x0

    @property
    def h(self) -> Length:
        """Its height, px."""
        return self.y1 - self.y0

    @property
    def size(self) -> tuple[Length, Length]:
        """Its width and height, px."""
        return self.x1 - self.x0, self.y1 - self.y0

    @property
    def length(self) -> Length:
        """Its longer side, px."""
        return max(self.x1 - self.x0, self.y1 - self.y0)

    @property
    def area(self) -> Length:
        """Its area, px²."""
        return (self.x1 - self.x0) * (self.y1 - self.y0)

    @property
    def slices(self) -> tuple[slice, slice]:
        """Its rows and columns, to index an image (h, w) with; for integer edges that are not negative."""
        return slice(self.y0, self.y1), slice(self.x0, self.x1)


def box_of_size(x: Length, y: Length, w: Length, h: Length) -> Box[Length]:
    """Return the box of this size whose upper left corner is (x, y)."""
    return Box(x, y, x + w, y + h)


def contains(outer: Box[Length], inner: Box[Length]) -> bool:
    """Return whether all of one box lies in another."""
    across = outer.x0 <= inner.x0 and inner.x1 <= outer.x1
    return across and outer.y0 <= inner.y0 and inner.y1 <= outer.y1


def overlap(a: Box[Length], b: Box[Length]) -> bool:
    """Return whether two boxes have a part in common; touching is not enough."""
    return a.x0 < b.x1 and b.x0 < a.x1 and a.y0 < b.y1 and b.y0 < a.y1


def intersection(a: Box[Length], b: Box[Length]) -> Box[Length] | None:
    """Return the part that two boxes have in common; None where there is none."""
    x0, y0, x1, y1 = max(a.x0, b.x0), max(a.y0, b.y0), min(a.x1, b.x1), min(a.y1, b.y1)
    return Box(x0, y0, x1, y1) if x1 > x0 and y1 > y0 else None


def clip(box: Box[int], size_px: tuple[int, int]) -> Box[int] | None:
    """Return the part of a box inside an image (w, h); None where there is none."""
    return intersection(box, Box(0, 0, *size_px))


def union(a: Box[Length], b: Box[Length]) -> Box[Length]:
    """Return the smallest box that holds two boxes."""
    return Box(min(a.x0, b.x0), min(a.y0, b.y0), max(a.x1, b.x1), max(a.y1, b.y1))


def expand(box: Box[Length], by: Length) -> Box[Length]:
    """Return a box with a margin on each side; it may reach beyond the image."""
    return Box(box.x0 - by, box.y0 - by, box.x1 + by, box.y1 + by)


def shift(box: Box[Length], dx: Length, dy: Length) -> Box[Length]:
    """Return a box moved by (dx, dy)."""
    return Box(box.x0 + dx, box.y0 + dy, box.x1 + dx, box.y1 + dy)
