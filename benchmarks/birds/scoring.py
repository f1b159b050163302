"""Score of a tracker on one flight: hits, points on the bird, and the time for which the aircraft was missed."""

from dataclasses import dataclass, field

import numpy as np

from birds.cutting import Box

RATE_HZ = 30.0
NEAR_PX = 10.0
_CAPTURE_FRAMES = 3
_BIRD_REACH, _LEAST_BIRD_PX = 0.75, 10.0
_STAYS = 3  # hits running

Point = tuple[float, float]


@dataclass(kw_only=True, eq=False)
class Score:
    """The frames of one flight: where the point was, None for none, and both boxes, the bird's None out of view."""

    points: list[Point | None] = field(default_factory=list)
    labels: list[Box] = field(default_factory=list)
    birds: list[Box | None] = field(default_factory=list)

    def add(self, point: Point | None, label: Box, bird: Box | None) -> None:
        """Take one frame."""
        self.points.append(point)
        self.labels.append(label)
        self.birds.append(bird)

    def hit(self, k: int) -> bool:
        """Whether the point is inside the labelled box or within 10 px of its middle."""
        point = self.points[k]
        return point is not None and is_hit(point, self.labels[k])

    def wrong(self, k: int) -> bool:
        """Whether there is a point and it is no hit."""
        return self.points[k] is not None and not self.hit(k)

    def on_bird(self, k: int) -> bool:
        """Whether the point is not a hit and is on the bird or near it."""
        point, bird = self.points[k], self.birds[k]
        if point is None or bird is None or self.hit(k):
            return False
        reach = max(_BIRD_REACH * max(bird[2:]), _LEAST_BIRD_PX)
        return float(np.hypot(point[0] - bird[0] - bird[2] / 2, point[1] - bird[1] - bird[3] / 2)) <= reach

    @property
    def clear_from(self) -> int:
        """The first frame after the last one in which the two boxes overlap; of a near miss, after the closest."""
        together = [k for k, b in enumerate(self.birds) if b is not None and _overlap(b, self.labels[k])]
        if together:
            return together[-1] + 1
        apart = [np.inf if b is None else _distance(b, self.labels[k]) for k, b in enumerate(self.birds)]
        return int(np.argmin(apart)) + 1

    @property
    def captured(self) -> bool:
        """Whether the bird was followed after the overlap: in three frames or more, or in the last one."""
        after = [self.on_bird(k) for k in range(self.clear_from, len(self.points))]
        return sum(after) >= _CAPTURE_FRAMES or (bool(after) and after[-1])

    @property
    def wrong_frames(self) -> int:
        """How many frames have a point that is no hit."""
        return sum(self.wrong(k) for k in range(len(self.points)))

    @property
    def back_after_s(self) -> float | None:
        """Time from the first clear frame until the aircraft is hit in three frames running; None if never."""
        last = len(self.points) - _STAYS
        for k in range(self.clear_from, last + 1):
            if all(self.hit(n) for n in range(k, k + _STAYS)):
                return (k - self.clear_from) / RATE_HZ
        return None

    @property
    def missed_after(self) -> int:
        """How many frames after the overlap show no hit."""
        return sum(not self.hit(k) for k in range(self.clear_from, len(self.points)))


def is_hit(point: Point, box: Box) -> bool:
    """Return whether a point is inside a labelled box or within 10 px of its middle."""
    (u, v), (x, y, w, h) = point, box
    inside = x <= u <= x + w and y <= v <= y + h
    return inside or float(np.hypot(u - x - w / 2, v - y - h / 2)) < NEAR_PX


def _overlap(a: Box, b: Box) -> bool:
    return a[0] < b[0] + b[2] and b[0] < a[0] + a[2] and a[1] < b[1] + b[3] and b[1] < a[1] + a[3]


def _distance(a: Box, b: Box) -> float:
    return float(np.hypot(a[0] + a[2] / 2 - b[0] - b[2] / 2, a[1] + a[3] / 2 - b[1] - b[3] / 2))
