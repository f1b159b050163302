"""Contact sheet of a session's worst frames: the picture around the aircraft, its silhouette and the reported point."""

from collections.abc import Sequence

import cv2
import numpy as np

from groundstation.arrays import ImageArray
from groundstation.bank.frame_outcomes import FrameOutcome
from groundstation.bank.session_truth import SessionTruth
from groundstation.messages import Frame
from groundstation.sources.folder_source import FolderSource

TILES = 4
_TILE_PX = (320, 240)
# width of the part shown, in widths of the aircraft and at least, px
_WIDTHS, _LEAST_PX = 3.0, 120
_QUALITY = 80
# BGR
_SILHOUETTE, _POINT, _TEXT = (120, 230, 120), (60, 60, 255), (255, 255, 255)
_ARM_PX = 7


def contact_sheet(truth: SessionTruth, outcomes: Sequence[FrameOutcome]) -> bytes:
    """Return a JPEG of `TILES` frames side by side; empty bytes for a session without any visible frame.

    Frames with a wrong point come first, then those without one, then hits; of each kind some spread over the session.
    """
    chosen = {(outcome.station, outcome.pair): outcome for outcome in _worst(outcomes)}
    if not chosen:
        return b""
    tiles = {}
    with FolderSource(truth.session) as source:
        for event in source:
            if isinstance(event, Frame) and (event.station, event.epoch) in chosen:
                outcome = chosen[event.station, event.epoch]
                tiles[event.epoch, event.station] = _tile(truth, outcome, event.image.whole(), event.t_s)
    ok, encoded = cv2.imencode(
        ".jpg", np.hstack([tiles[k] for k in sorted(tiles)]), [cv2.IMWRITE_JPEG_QUALITY, _QUALITY]
    )
    return encoded.tobytes() if ok else b""


def _worst(outcomes: Sequence[FrameOutcome]) -> list[FrameOutcome]:
    """Return up to `TILES` visible frames, wrong ones before missed ones before hits."""
    visible = [outcome for outcome in outcomes if outcome.visible]
    kinds = (
        [outcome for outcome in visible if outcome.wrong],
        [outcome for outcome in visible if outcome.pixel_px is None],
        [outcome for outcome in visible if outcome.hit],
    )
    chosen: list[FrameOutcome] = []
    for kind in kinds:
        room = min(TILES - len(chosen), len(kind))
        if room > 0:
            ordered = sorted(kind, key=lambda outcome: (outcome.pair, outcome.station))
            chosen += [ordered[(2 * k + 1) * len(ordered) // (2 * room)] for k in range(room)]
    return chosen


def _tile(truth: SessionTruth, outcome: FrameOutcome, image: ImageArray, t_s: float) -> ImageArray:
    """Return the part of a picture around the aircraft, with its outline and the reported point."""
    there = truth.frame(outcome.station, outcome.pair)
    picture = image if image.ndim == 3 else cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    width, height = _TILE_PX
    side = _LEAST_PX if there is None else max(_WIDTHS * there.silhouette.width_px, _LEAST_PX)
    centre = np.array([picture.shape[1], picture.shape[0]]) / 2.0 if there is None else there.silhouette.centre_px
    scale = width / side
    # from pixels of the picture to those of the tile
    shift = np.array([width, height]) / 2.0 - scale * centre
    transform = np.array([[scale, 0.0, shift[0]], [0.0, scale, shift[1]]])
    mode = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_LINEAR
    tile: ImageArray = np.asarray(cv2.warpAffine(picture, transform, (width, height), flags=mode), dtype=np.uint8)
    if there is not None:
        mask = np.pad(there.silhouette.mask.astype(np.uint8), 1)
        pieces, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        corner = np.array([there.silhouette.x - 1, there.silhouette.y - 1])
        for piece in pieces:
            outline = np.round(scale * (piece.reshape(-1, 2) + corner) + shift).astype(np.int32)
            cv2.polylines(tile, [outline], True, _SILHOUETTE, 1)
    if outcome.pixel_px is not None:
        u, v = np.round(scale * outcome.pixel_px + shift).astype(int).tolist()
        cv2.line(tile, (u - _ARM_PX, v), (u + _ARM_PX, v), _POINT, 1)
        cv2.line(tile, (u, v - _ARM_PX), (u, v + _ARM_PX), _POINT, 1)
    result = "hit" if outcome.hit else "wrong" if outcome.wrong else "missed"
    cv2.putText(tile, f"{outcome.station} {t_s:.1f} s {result}", (6, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (0, 0, 0), 3)
    cv2.putText(tile, f"{outcome.station} {t_s:.1f} s {result}", (6, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.45, _TEXT, 1)
    return tile
