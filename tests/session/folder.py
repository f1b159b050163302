"""Tiny synthetic session folders: each picture carries its own number in stripes."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from groundstation.arrays import ImageArray

SIZE = (64, 48)
STRIPE_PX = 5
BITS = SIZE[0] // STRIPE_PX

SESSION = """name = "tiny"
licence = "CC0"

[target]
span_m = 2.0
"""

STATION = """
[[station]]
name = "{name}"
fixed = {fixed}
ptu_position_m = [{x}, 0.0, 1.5]
runway_from_base_wxyz = [1.0, 0.0, 0.0, 0.0]
head_from_camera_wxyz = [0.70710678, -0.70710678, 0.0, 0.0]
image_size_px = [64, 48]
focal_px = [300.0, 300.0]
principal_point_px = [31.5, 23.5]
ptu_resolution_deg = 0.00625
{more}
"""


def picture(number: int) -> ImageArray:
    """Stripes from the left, white where the bit of `number` is set."""
    image = np.zeros((SIZE[1], SIZE[0], 3), dtype=np.uint8)
    for bit in range(BITS):
        image[:, bit * STRIPE_PX : (bit + 1) * STRIPE_PX] = 255 * (number >> bit & 1)
    return image


def number_of(image: ImageArray) -> int:
    middles = image[SIZE[1] // 2, STRIPE_PX // 2 : BITS * STRIPE_PX : STRIPE_PX].mean(axis=1) > 127
    return int(sum(1 << bit for bit in np.flatnonzero(middles)))


def write_video(path: Path, numbers: Iterable[int], fourcc: str = "MJPG", *, colour: bool = True) -> None:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*fourcc), 10.0, SIZE, colour)
    assert writer.isOpened()
    for number in numbers:
        image = picture(number)
        writer.write(image if colour else np.ascontiguousarray(image[:, :, 0]))
    writer.release()


def write_pictures(folder: Path, numbers: Iterable[int]) -> None:
    folder.mkdir()
    for number in numbers:
        assert cv2.imwrite(str(folder / f"{number:06d}.png"), picture(number))


def rig_text(names: Sequence[str], fixed: Sequence[str] = (), more: Mapping[str, str] | None = None) -> str:
    text = 'format = "stereo-ptu-rig/1"\n'
    for i, name in enumerate(names):
        is_fixed = str(name in fixed).lower()
        text += STATION.format(name=name, fixed=is_fixed, x=5.0 * i - 5.0, more=(more or {}).get(name, ""))
    return text


def edit_line(path: Path, line: int, new: str) -> None:
    """Replace one line, counted from 1."""
    lines = path.read_text().splitlines()
    lines[line - 1] = new
    path.write_text("\n".join(lines) + "\n")


def replace_in(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


@dataclass(kw_only=True)
class Tiny:
    """What to write; `stamps` by station holds a time or None for each row, `index` the rows' numbers."""

    names: tuple[str, ...] = ("left", "right")
    fixed: tuple[str, ...] = ()
    rows: int = 12
    index: tuple[int, ...] | None = None
    stamps: dict[str, list[float | None]] = field(default_factory=dict)
    ptu_from_s: float = 0.7
    ptu_to_s: float = 2.5
    ptu_step_s: float = 0.05
    video: str = "avi"
    session: str = SESSION
    rig_more: dict[str, str] = field(default_factory=dict)

    def times(self, name: str) -> list[float | None]:
        return self.stamps.get(name, [1.0 + 0.1 * k for k in range(self.rows)])

    def write(self, folder: Path) -> Path:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "session.toml").write_text(self.session)
        (folder / "rig.toml").write_text(rig_text(self.names, self.fixed, self.rig_more))
        index = self.index or tuple(range(self.rows))
        lines = [",".join(["index", *(f"{n}_t_s" for n in self.names)])]
        columns = [self.times(n) for n in self.names]
        for number, *stamps in zip(index, *columns, strict=True):
            lines.append(",".join([str(number), *("" if t is None else f"{t:.6f}" for t in stamps)]))
        (folder / "frames.csv").write_text("\n".join(lines) + "\n")
        for name in self.names:
            if self.video == "avi":
                write_video(folder / f"{name}.avi", range(index[-1] + 1))
            elif self.video == "png":
                given = [i for i, t in zip(index, self.times(name), strict=True) if t is not None]
                write_pictures(folder / name, given)
        turning = [n for n in self.names if n not in self.fixed]
        if turning:
            (folder / "ptu.csv").write_text(self._ptu(turning))
        return folder

    def _ptu(self, turning: list[str]) -> str:
        lines = [",".join(["t_s", *(f"{n}_{axis}_deg" for n in turning for axis in ("pan", "tilt"))])]
        steps = round((self.ptu_to_s - self.ptu_from_s) / self.ptu_step_s)
        for k in range(steps + 1):
            cells = [f"{self.ptu_from_s + k * self.ptu_step_s:.6f}"]
            cells += [f"{0.1 * i + 0.01 * k:.5f}" for i in range(2 * len(turning))]
            lines.append(",".join(cells))
        return "\n".join(lines) + "\n"
