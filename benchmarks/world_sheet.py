"""A sheet of drawn worlds, to look at: for each, what one station sees in the middle of the flight.

    python benchmarks/world_sheet.py OUT.png [--first SEED] [--count N] [--columns N] [--width PX]

The line above each picture names seed, airframe, flight, scenery and sky; a frame is drawn around the true silhouette.
"""

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from groundstation.arrays import ImageArray
from groundstation.bank.session_truth import SessionTruth
from groundstation.messages import Frame
from groundstation.session import load_session
from groundstation.simulation.world.draw_world import DURATION_S, draw_world
from groundstation.simulation.world.render_world import render_world
from groundstation.simulation.world.world import world_factors
from groundstation.sources.folder_source import FolderSource

_MARGIN_PX = 6
_WORDS = ("airframe", "flight", "scenery", "sky", "traffic")
_HEAD_PX = 18


def middle_picture(seed: int, folder: Path) -> ImageArray:
    """Return the picture of the first station that has one of the flight's middle, BGR."""
    world = replace(draw_world(seed), frame_hz=2.0 / DURATION_S)
    render_world(world, folder)
    truth = SessionTruth(load_session(folder))
    with FolderSource(truth.session) as source:
        frames = [event for event in source if isinstance(event, Frame)]
    frame = min(frames, key=lambda event: (abs(event.epoch - 1), event.station))
    picture = np.array(frame.image.whole())
    if picture.ndim == 2:
        picture = np.asarray(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    there = truth.frame(frame.station, frame.epoch)
    if there is not None:
        x, y, (h, w) = there.silhouette.x, there.silhouette.y, there.silhouette.mask.shape
        corners = (x - _MARGIN_PX, y - _MARGIN_PX), (x + w + _MARGIN_PX, y + h + _MARGIN_PX)
        cv2.rectangle(picture, *corners, (0, 255, 255), max(picture.shape[1] // 640, 1))
    return picture


def tile(seed: int, width: int) -> ImageArray:
    """Return a picture of 4 to 3 with its line."""
    with tempfile.TemporaryDirectory(prefix="world-sheet-") as name:
        picture = middle_picture(seed, Path(name) / "session")
    height = 3 * width // 4
    scale = min(width / picture.shape[1], height / picture.shape[0])
    size = round(scale * picture.shape[1]), round(scale * picture.shape[0])
    shown = np.zeros((height + _HEAD_PX, width, 3), np.uint8)
    shown[_HEAD_PX : _HEAD_PX + size[1], : size[0]] = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    factors = world_factors(draw_world(seed))
    words = f"{seed} " + ", ".join(factors[name] for name in _WORDS)
    cv2.putText(shown, words, (3, 13), cv2.FONT_HERSHEY_SIMPLEX, 0.38, (255, 255, 255), 1, cv2.LINE_AA)
    return shown


def main() -> None:
    """Write the sheet."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=50)
    parser.add_argument("--columns", type=int, default=5)
    parser.add_argument("--width", type=int, default=380)
    options = parser.parse_args()
    tiles = [tile(options.first + k, options.width) for k in range(options.count)]
    tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % options.columns)
    rows = [np.hstack(tiles[k : k + options.columns]) for k in range(0, len(tiles), options.columns)]
    cv2.imwrite(str(options.out), np.vstack(rows))
    print(f"wrote {options.out}")


if __name__ == "__main__":
    main()
