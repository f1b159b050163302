"""Pictures of composites that failed, for the eye."""

from pathlib import Path

import cv2
import numpy as np

from birds.cutting import Box
from groundstation.arrays import ImageArray
from groundstation.messages import Detection


def draw(image: ImageArray, label: Box, bird: Box | None, seen: Detection | None) -> ImageArray:
    """Return the surroundings of the label: label green, bird blue, what was seen red."""
    side, scale = 128, 2
    cx, cy = round(label[0] + label[2] / 2), round(label[1] + label[3] / 2)
    padded = cv2.copyMakeBorder(image, side, side, side, side, cv2.BORDER_REPLICATE)
    picture = cv2.resize(
        padded[cy : cy + 2 * side, cx : cx + 2 * side], None, fx=scale, fy=scale, interpolation=cv2.INTER_NEAREST
    )
    outlined = None if seen is None else (seen.box.x0, seen.box.y0, *seen.box.size)
    for box, colour in ((label, (0, 200, 0)), (bird, (255, 80, 0)), (outlined, (0, 0, 255))):
        if box is not None:
            x, y, w, h = box
            corner = (round(scale * (x - cx + side)), round(scale * (y - cy + side)))
            cv2.rectangle(picture, corner, (corner[0] + round(scale * w), corner[1] + round(scale * h)), colour, 1)
    if seen is not None:
        at = (round(scale * (seen.u_px - cx + side)), round(scale * (seen.v_px - cy + side)))
        cv2.circle(picture, at, 3, (0, 0, 255), -1)
    return np.asarray(picture, np.uint8)


def save(folder: Path, number: int, pictures: dict[int, ImageArray]) -> None:
    """Write a sheet of pictures around the overlap."""
    folder.mkdir(parents=True, exist_ok=True)
    tiles = []
    for index, picture in sorted(pictures.items()):
        cv2.putText(picture, str(index), (6, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 255, 255), 1)
        tiles.append(picture)
    while len(tiles) % 4:
        tiles.append(np.zeros_like(tiles[0]))
    rows = [np.hstack(tiles[k : k + 4]) for k in range(0, len(tiles), 4)]
    cv2.imwrite(str(folder / f"{number:03d}.png"), np.vstack(rows))
