"""Drawn aircraft over real clips, tracked with one camera: a table of hits by condition, and a sheet to look at.

    GROUNDSTATION_DATA=… python benchmarks/composites.py [--set validate] [--number N] [--first INDEX] [--out DIR]
        [--detector classic]

Each composite is tracked from the true box in its first visible frame on. A hit is a point inside the silhouette or
within 4 px of it, wrong any other point; both are shares of the visible frames. DIR/composites-SET.png has
for each composite the whole picture and two close looks of 3 times the aircraft's width, one of them with the
silhouette's outline; --measures prints what is measured in each clip instead.
"""

import argparse
import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from groundstation.arrays import ImageArray
from groundstation.bank.composites.composite_row import FrameVerdict, JudgedFrame, row_of, track_composite
from groundstation.bank.composites.draw_composite import draw_composite
from groundstation.bank.composites.render_composite import CompositeFrame, render_composite
from groundstation.bank.composites.segment_view import CompositeClips
from groundstation.detection.config import DetectorKind
from groundstation.simulation.world.world_sets import WorldSet, seed_of
from groundstation.tracking.warm_up import warm_up

_TILE_PX = 240
_WIDTHS, _LEAST_PX = 3.0, 48.0
_FACTORS = ("family", "size", "background", "birds", "clip")
_OUTLINE, _LABEL, _POINT = (120, 230, 120), (0, 200, 255), (60, 60, 255)


def close_look(frame: CompositeFrame, outlined: bool) -> ImageArray:
    """Return the part of a picture around the aircraft, enlarged."""
    if frame.silhouette is None:
        return np.zeros((_TILE_PX, _TILE_PX, 3), np.uint8)
    side = max(_WIDTHS * frame.silhouette.width_px, _LEAST_PX)
    scale = _TILE_PX / side
    shift = 0.5 * _TILE_PX - scale * frame.silhouette.centre_px
    transform = np.array([[scale, 0.0, shift[0]], [0.0, scale, shift[1]]])
    mode = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_NEAREST
    tile = cv2.warpAffine(frame.image, transform, (_TILE_PX, _TILE_PX), flags=mode)
    if outlined:
        mask = cv2.copyMakeBorder(frame.silhouette.mask.astype(np.uint8), 1, 1, 1, 1, cv2.BORDER_CONSTANT)
        for piece in cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]:
            corner = np.array([frame.silhouette.x - 1, frame.silhouette.y - 1])
            line = np.round(scale * (piece.reshape(-1, 2) + corner) + shift).astype(np.int32)
            cv2.polylines(tile, [line], True, _OUTLINE, 1)
    return np.asarray(tile, np.uint8)


def strip(row: dict[str, Any], judged: JudgedFrame) -> ImageArray:
    """Return one composite's pictures, one next to the other."""
    frame = judged.frame
    whole = cv2.resize(frame.image, (_TILE_PX * 5 // 4, _TILE_PX), interpolation=cv2.INTER_AREA)
    ratio = _TILE_PX / frame.image.shape[0]
    real = frame.real_aircraft
    if real is not None:
        corners = [tuple(round(ratio * v) for v in point) for point in ((real.x0, real.y0), (real.x1, real.y1))]
        cv2.rectangle(whole, corners[0], corners[1], _LABEL, 1)
    share = row["hit_share"]
    words = f"{row['seed']} {row['clip'][-3:]}/{frame.index} {row['family']} {frame.width_px:.0f} px"
    shares = f"hit {'-' if share is None else f'{share:.2f}'} snr {frame.snr:.0f} {judged.verdict}"
    for k, text in enumerate((words, shares)):
        for colour, thickness in (((0, 0, 0), 3), ((255, 255, 255), 1)):
            cv2.putText(whole, text, (4, 14 + 16 * k), cv2.FONT_HERSHEY_SIMPLEX, 0.4, colour, thickness, cv2.LINE_AA)
    return np.hstack([whole, close_look(frame, False), close_look(frame, True)])


def shares_line(name: str, rows: Sequence[dict[str, Any]]) -> str:
    """Return one line of the table: distribution of hits and wrong points over composites, and pooled shares."""
    judged = [row for row in rows if row["visible_frames"]]
    if not judged:
        return f"{name:24s} {len(rows):4d}  no visible frame"
    hit, wrong = (np.array([row[f"{kind}_share"] for row in judged]) for kind in ("hit", "wrong"))
    frames = sum(row["visible_frames"] for row in judged)
    pooled = [sum(row[kind] for row in judged) / frames for kind in ("hit", "wrong")]
    quarters = [np.percentile(values, (25, 50, 75)) for values in (hit, wrong)]
    text = "   ".join(" ".join(f"{100 * v:6.1f}" for v in (*q, p)) for q, p in zip(quarters, pooled, strict=True))
    return f"{name:24s} {len(judged):4d} {frames:6d}   {text}"


def print_table(rows: Sequence[dict[str, Any]]) -> None:
    """Print the distribution, the worst five, and each factor."""
    print(f"{'':24s}    n frames   hit % lower, median, upper quartile, pooled;  wrong % likewise")
    print(shares_line("all", rows))
    for factor in _FACTORS:
        for value in sorted({row[factor] for row in rows}):
            print(shares_line(f"{factor} {value}", [row for row in rows if row[factor] == value]))
    worst = sorted((row for row in rows if row["visible_frames"]), key=lambda row: row["hit_share"])[:5]
    print("worst five:")
    for row in worst:
        print("  " + " ".join(f"{k}={v:.3g}" if isinstance(v, float) else f"{k}={v}" for k, v in row.items()))


def print_measures(clips: CompositeClips, world_set: WorldSet) -> None:
    """Print what is measured in each clip of a set."""
    for segment in clips.segments(world_set):
        part, view = clips.measured(segment)
        light = view.light
        print(
            f"{part.clip} {part.first}-{part.last}: blur {view.blur_px:.2f} px, noise {view.noise.sigma:.2f} levels "
            f"smooth to {view.noise.blur_px:.2f} px, clearness {light.clearness:.2f}, sky "
            f"{np.round(light.sky_bgr, 2).tolist()}, horizon {view.horizon_row}, moved {view.shifts_px[-1].round(1)}",
            flush=True,
        )


def main() -> None:
    """Draw, track and judge composites; print the table and write the sheet."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--set", type=WorldSet, choices=(WorldSet.TRAIN, WorldSet.VALIDATE), default=WorldSet.VALIDATE)
    parser.add_argument("--number", type=int, default=40)
    parser.add_argument("--first", type=int, default=0, metavar="INDEX")
    parser.add_argument("--out", type=Path, default=Path("out"))
    parser.add_argument("--columns", type=int, default=2)
    parser.add_argument("--detector", type=DetectorKind, choices=tuple(DetectorKind), default=DetectorKind.LEARNED)
    parser.add_argument("--measures", action="store_true")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    clips = CompositeClips(Path(os.environ["GROUNDSTATION_DATA"]) / "aircraft-clips")
    if options.measures:
        print_measures(clips, options.set)
        return
    warm_up(options.detector)
    specs = [
        draw_composite(seed_of(options.set, k), clips) for k in range(options.first, options.first + options.number)
    ]
    rows, strips = [], {}
    # one clip after the other, so that each is decoded once
    for spec in sorted(specs, key=lambda spec: (spec.clip, spec.first)):
        footage = clips.footage(options.set, spec.clip, spec.first)
        judged = list(track_composite(render_composite(spec, footage), options.detector))
        row = row_of(spec, judged)
        rows.append(row)
        print(json.dumps(row), flush=True)
        if judged:
            failed = [each for each in judged if each.verdict is not FrameVerdict.HIT]
            chosen = failed[len(failed) // 2] if len(failed) > 0.1 * len(judged) else judged[len(judged) // 2]
            strips[spec.seed] = strip(row, chosen)
    print_table(rows)
    pictures = [strips[seed] for seed in sorted(strips)]
    while len(pictures) % options.columns:
        pictures.append(np.zeros_like(pictures[0]))
    height = len(pictures) // options.columns
    columns = [np.vstack(pictures[k * height : (k + 1) * height]) for k in range(options.columns)]
    options.out.mkdir(parents=True, exist_ok=True)
    path = options.out / f"composites-{options.set}.png"
    cv2.imwrite(str(path), np.hstack(columns))
    print(f"wrote {path}")


if __name__ == "__main__":
    main()
