"""The learned channel's log odds on targets and elsewhere: how many targets are found for how many false responses.

    python benchmarks/channel_odds.py --out DIR [--set SET] [--first N] [--worlds N] [--pictures N] [--weights FILE]
                                      [--widths PX …]

Pictures are filmed as for training, once for a folder, of train worlds that no weights were trained on by default. For
each width that a target has in its window, and for targets in the middle of it or anywhere so that all of it is inside,
the table has the share of targets with a pixel above even odds, and above those odds that a given share of the windows
elsewhere reaches. Windows elsewhere show no aircraft and no bird.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from channel_worlds import targets_of

from groundstation.arrays import FloatArray
from groundstation.detection.channel_window import TARGET_PX, WINDOW_PX
from groundstation.detection.learned_channel import LearnedChannel
from groundstation.files.channel_weights import WEIGHTS, read_weights
from groundstation.simulation.world.world_sets import WorldSet
from training.recorded_windows import RecordedTarget, target_window

_STREAM = 617
_FALSE_SHARES = (0.02, 0.01, 0.005)
# of a window's pixels: those of the target; and what is nothing
_ON_TARGET, _NOTHING, _BIRD = 0.3, 0.05, 0.3
# half a target of width 1, with its height, and a rim, px
_HALF, _RIM_PX = np.array([0.6, 0.35]), 4.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Odds:
    """Largest log odds on each target (n,), and in each window elsewhere (m,)."""

    targets: FloatArray
    elsewhere: FloatArray


def odds_of(channel: LearnedChannel, targets: list[RecordedTarget], width_px: float, *, anywhere: bool) -> Odds:
    """Return the odds in windows in which targets are so wide, in the middle or anywhere."""
    generator = np.random.default_rng([_STREAM, round(width_px), anywhere])
    middle = np.array(WINDOW_PX) / 2.0 - 0.5
    room = np.array(WINDOW_PX) / 2.0 - width_px * _HALF - _RIM_PX
    own, other = [], []
    for target in targets:
        off = generator.uniform(-1.0, 1.0, 2) * room if anywhere else np.zeros(2)
        shown = target_window(target, width_px, middle + off)
        odds = channel.maps(shown.image).aircraft
        mask = shown.aircraft > _ON_TARGET
        if target.around_target and mask.any():
            own.append(float(odds[mask].max()))
        elif not target.around_target and shown.aircraft.max() < _NOTHING and shown.other.max() < _BIRD:
            other.append(float(odds.max()))
    return Odds(targets=np.array(own), elsewhere=np.array(other))


def rows(channel: LearnedChannel, targets: list[RecordedTarget], widths: list[float]) -> Iterator[str]:
    """Yield the lines of the table."""
    shares = "".join(f"{f'found at {100 * share:g} %':>16}" for share in _FALSE_SHARES)
    yield f"{'width px':>8}{'place':>10}{'targets':>9}{'elsewhere':>11}{'found':>8}{'false':>8}{shares}"
    for width in widths:
        for anywhere in (False, True):
            odds = odds_of(channel, targets, width, anywhere=anywhere)
            found, false = (float(np.mean(each > 0.0)) for each in (odds.targets, odds.elsewhere))
            at = [float(np.mean(odds.targets > np.quantile(odds.elsewhere, 1.0 - share))) for share in _FALSE_SHARES]
            line = (
                f"{width:8g}{'anywhere' if anywhere else 'middle':>10}{odds.targets.size:9d}{odds.elsewhere.size:11d}"
            )
            yield line + f"{100 * found:8.1f}{100 * false:8.1f}" + "".join(f"{100 * share:16.1f}" for share in at)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the filmed pictures")
    parser.add_argument("--set", type=WorldSet, default=WorldSet.TRAIN, choices=list(WorldSet), dest="world_set")
    parser.add_argument("--first", type=int, default=500, metavar="N")
    parser.add_argument("--worlds", type=int, default=40, metavar="N")
    parser.add_argument("--pictures", type=int, default=12, metavar="N")
    parser.add_argument("--weights", type=Path, default=WEIGHTS)
    parser.add_argument("--widths", type=float, nargs="+", default=[TARGET_PX], metavar="PX")
    given = parser.parse_args()
    channel = LearnedChannel(read_weights(given.weights, None))
    numbers = range(given.first, given.first + given.worlds)
    targets = [t for number in numbers for t in targets_of(given.out, given.world_set, number, given.pictures)]
    for line in rows(channel, targets, given.widths):
        print(line, flush=True)


if __name__ == "__main__":
    main()
