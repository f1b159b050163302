"""A folder of two small clips, one of each set: sky over rough ground, a camera that pans, and an aircraft."""

from pathlib import Path

import cv2
import numpy as np

from groundstation.arrays import ImageArray

SIZE_PX, FRAMES = (256, 192), 50
PAN_PX = 0.5
SKY_BGR, SKYLINE_ROW = (200.0, 150.0, 110.0), 148
_BOX_PX = 16


def scene(seed: int) -> ImageArray:
    """Return a wide still of sky and ground."""
    g = np.random.default_rng(seed)
    height, width = SIZE_PX[1], SIZE_PX[0] + round(PAN_PX * FRAMES) + 2
    picture = np.tile(np.array(SKY_BGR), (height, width, 1))
    rough = cv2.GaussianBlur(g.normal(0.0, 500.0, (height - SKYLINE_ROW, width)), (0, 0), 5.0)
    picture[SKYLINE_ROW:] = np.array([60.0, 80.0, 85.0]) + rough[:, :, None]
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8)


def write_clips(folder: Path) -> Path:
    """Write clips 001 and 021 with their tables."""
    boxes, segments = ["clip,frame,x,y,w,h"], ["clip,first_frame,last_frame,kind"]
    for number in (1, 21):
        name = f"V_AIRPLANE_{number:03d}"
        writer = cv2.VideoWriter(str(folder / f"{name}.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 30.0, SIZE_PX)
        assert writer.isOpened()
        still = scene(number)
        for k in range(FRAMES):
            x, y = 20 + k, 80
            moved = np.array([[1.0, 0.0, -PAN_PX * k], [0.0, 1.0, 0.0]])
            image = np.asarray(cv2.warpAffine(still, moved, SIZE_PX), np.uint8)
            image[y + 6 : y + 10, x + 4 : x + 12] = 40
            writer.write(image)
            boxes.append(f"{name},{k},{x},{y},{_BOX_PX},{_BOX_PX}")
        writer.release()
        segments.append(f"{name},0,{FRAMES - 1},aircraft")
    (folder / "boxes.csv").write_text("\n".join(boxes) + "\n")
    (folder / "segments.csv").write_text("\n".join(segments) + "\n")
    return folder
