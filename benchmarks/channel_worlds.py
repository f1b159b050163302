"""The learned channel on pictures of drawn worlds: hits by what is drawn, and whether noses err as they should.

    python benchmarks/channel_worlds.py --out DIR [--set SET] [--first N] [--worlds N] [--pictures N] [--weights FILE]
                                        [--sheet PNG]

Pictures are filmed as for training (`training/filmed_targets.py`), once for a folder, of worlds of a set by number. A
window whose middle is off the silhouette's by up to 0.3 of its width and whose scale by 0.6 to 1.6 is hit where the
strongest response to aircraft is on the silhouette or within 4 px of it, in pictures reduced to targets of at most 66
px; a window elsewhere, some of them around birds, fires where even odds are reached off the target. Another aircraft in
the air counts as the target. d² is the nose's normalised square error, 2 where the covariance is true. A sheet has the
hundred worst windows: the picture, and next to it the odds (white is aircraft) with the true silhouette's outline.
"""

import argparse
import math
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from groundstation.arrays import Float32Array, ImageArray, MaskArray
from groundstation.detection.channel_candidate import candidates_of
from groundstation.detection.channel_window import TARGET_PX, WINDOW_PX
from groundstation.detection.config import DetectionConfig
from groundstation.detection.learned_channel import LearnedChannel
from groundstation.detection.nose_hypotheses import nose_in
from groundstation.files.channel_weights import WEIGHTS, read_weights
from groundstation.simulation.world.draw_world import draw_world
from groundstation.simulation.world.world import world_factors
from groundstation.simulation.world.world_sets import WorldSet, seed_of
from training.filmed_targets import filmed_targets
from training.recorded_windows import RecordedTarget, load_targets, save_targets, target_window
from training.windows import LabelledWindow

_STREAM = 611
_NEAR_PX = 4.0
_LIMIT = 8.0
_ROWS, _COLUMNS = 20, 5
_FACTORS = ("airframe", "scenery", "sky", "flight", "visibility")


@dataclass(frozen=True, slots=True, kw_only=True)
class WindowResult:
    """What the channel made of one window; d² and error of the nose, in widths, are NaN where it is not a hit.

    ``badness`` is how much likelier, in log odds, the strongest response off the target is than that on it; where no
    target is expected, the log odds of the former. ``shown`` (96, 256, 3) is the window, and its odds with the truth.
    """

    factors: dict[str, str]
    elsewhere: bool
    hit: bool
    fired: bool
    iou: float
    d2: float
    nose_error: float
    width_px: float
    badness: float
    shown: ImageArray


def targets_of(folder: Path, world_set: WorldSet, number: int, pictures: int) -> tuple[RecordedTarget, ...]:
    """Return a world's pictures, filmed now or found in the folder."""
    path = folder / f"{world_set}-{number:05d}-{pictures}.npz"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        world = draw_world(seed_of(world_set, number))
        save_targets(tuple(filmed_targets(world, pictures, np.random.default_rng([world.seed, _STREAM]))), path)
    return load_targets(path)


def results(
    channel: LearnedChannel, folder: Path, world_set: WorldSet, numbers: range, pictures: int
) -> Iterator[WindowResult]:
    """Yield a result for each window of the worlds."""
    mu = DetectionConfig().level_set.mu
    for number in numbers:
        factors = world_factors(draw_world(seed_of(world_set, number)))
        generator = np.random.default_rng([seed_of(world_set, number), _STREAM, 1])
        for target in targets_of(folder, world_set, number, pictures):
            size = TARGET_PX * math.exp(float(generator.uniform(math.log(0.6), math.log(1.6))))
            off = generator.uniform(-0.3, 0.3, 2) * size
            shown = target_window(target, size, np.array(WINDOW_PX) / 2.0 - 0.5 + off)
            yield _result(channel, mu, shown, (size, target.width_px), factors, elsewhere=not target.around_target)


def _result(
    channel: LearnedChannel,
    mu: float,
    shown: LabelledWindow,
    widths: tuple[float, float],
    factors: dict[str, str],
    *,
    elsewhere: bool,
) -> WindowResult:
    maps, mask, nose = channel.maps(shown.image), shown.aircraft >= 0.5, shown.nose_px
    v, u = np.unravel_index(int(np.argmax(maps.aircraft)), maps.aircraft.shape)
    size, width = widths
    away = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 5) if mask.any() else np.full(mask.shape, 1e9)
    near = max(_NEAR_PX * size / width, 1.0)
    hit = bool(away[v, u] <= near)
    found = maps.aircraft > 0.0
    d2 = error = math.nan
    candidates = candidates_of(maps, mu)
    if hit and candidates and np.all(np.isfinite(nose)):
        point, covariance = nose_in(maps, max(candidates, key=lambda c: c.odds))
        off = point - nose
        d2, error = float(off @ np.linalg.solve(covariance, off)), float(np.hypot(*off)) / size
    on, off_target = (float(maps.aircraft[where].max(initial=-_LIMIT)) for where in (away <= near, away > near))
    iou = float((found & mask).sum() / max((found | mask).sum(), 1))
    return WindowResult(
        factors=factors,
        elsewhere=elsewhere,
        hit=hit,
        fired=bool((found & (away > near)).any()),
        iou=iou,
        d2=d2,
        nose_error=error,
        width_px=width,
        badness=off_target if elsewhere else off_target - on,
        shown=_pictured(shown.image, maps.aircraft, mask),
    )


def _pictured(image: ImageArray, odds: Float32Array, mask: MaskArray) -> ImageArray:
    """Return a window and its odds (96, 256, 3), the outline of the mask in red on the latter."""
    grey = np.asarray(np.clip(127.5 + 127.5 * odds / _LIMIT, 0.0, 255.0), np.uint8)
    odds_picture = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)
    contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(odds_picture, contours, -1, (0, 0, 255), 1)
    return np.asarray(np.hstack([image, odds_picture]), np.uint8)


def sheet(found: list[WindowResult]) -> ImageArray:
    """Return the worst windows, the worst first, row by row."""
    worst = [r.shown for r in sorted(found, key=lambda r: -r.badness)[: _ROWS * _COLUMNS]]
    worst += [np.zeros_like(worst[0])] * (_ROWS * _COLUMNS - len(worst))
    return np.asarray(np.vstack([np.hstack(worst[k : k + _COLUMNS]) for k in range(0, len(worst), _COLUMNS)]), np.uint8)


def _print(found: list[WindowResult]) -> None:
    own = [r for r in found if not r.elsewhere]
    other = [r for r in found if r.elsewhere]

    def share(part: list[WindowResult], what: Callable[[WindowResult], bool]) -> float:
        return float(np.mean([what(r) for r in part])) if part else math.nan

    print(f"windows {len(own)}, hit {share(own, lambda r: r.hit):.3f}, IoU {np.median([r.iou for r in own]):.3f}")
    print(f"windows elsewhere {len(other)}, fire off the target {share(other, lambda r: r.fired):.3f}")
    with_nose = [r for r in own if math.isfinite(r.d2)]
    print(f"{'width px':16}{'n':>6}{'hit':>8}{'error/width':>13}{'d2 mean':>9}{'median':>8}{'90 %':>8}")
    for low, high in ((0, 16), (16, 32), (32, 67), (0, 67)):
        part = [r for r in own if low <= r.width_px < high]
        noses = [r for r in with_nose if low <= r.width_px < high]
        if noses:
            d2 = np.array([r.d2 for r in noses])
            middle = np.median([r.nose_error for r in noses])
            figures = f"{middle:13.3f}{d2.mean():9.2f}{np.median(d2):8.2f}{np.quantile(d2, 0.9):8.2f}"
            print(f"{f'{low} to {high}':16}{len(part):6d}{share(part, lambda r: r.hit):8.3f}{figures}")
    for factor in _FACTORS:
        groups: dict[str, list[WindowResult]] = defaultdict(list)
        for r in own:
            groups[r.factors.get(factor, "–")].append(r)
        for name, part in sorted(groups.items(), key=lambda item: share(item[1], lambda r: r.hit)):
            print(f"{factor:12}{name:24}{len(part):6d}{share(part, lambda r: r.hit):8.3f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the filmed pictures")
    parser.add_argument("--set", type=WorldSet, default=WorldSet.VALIDATE, choices=list(WorldSet), dest="world_set")
    parser.add_argument("--first", type=int, default=0, metavar="N")
    parser.add_argument("--worlds", type=int, default=60, metavar="N")
    parser.add_argument("--pictures", type=int, default=12, metavar="N")
    parser.add_argument("--weights", type=Path, default=WEIGHTS)
    parser.add_argument("--sheet", type=Path, metavar="PNG", help="draw the hundred worst windows")
    given = parser.parse_args()
    channel = LearnedChannel(read_weights(given.weights, None))
    numbers = range(given.first, given.first + given.worlds)
    found = list(results(channel, given.out, given.world_set, numbers, given.pictures))
    _print(found)
    if given.sheet is not None:
        cv2.imwrite(str(given.sheet), sheet(found))


if __name__ == "__main__":
    main()
