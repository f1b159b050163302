"""Cost of the compiled narrow band, against the full grid and scikit-image, and equality of the regions.

    python benchmarks/level_set_speed.py [--out DIR] [SESSION]

1. On 250 × 100 px regions of a session (default the bundled landing) and a made-up one: time of each level set from
   the same start with the same rule for stopping, and the overlap with the full grid at rest.
2. Time against the contour's length (discs of 5 … 40 px radius in 250 × 100 px) and against the region's size (one
   disc in growing regions): the exponents.
3. The whole detector in 250 × 100 px regions: median and 99 %.
4. Global against region-scalable (local) fitting under light that is uneven across a drawn picture.

One thread; times are its processor time. Tables and pictures go to DIR, default out/level-set-speed.
"""

import argparse
import math
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from skimage.segmentation import chan_vese as skimage_chan_vese

from groundstation.box import Box
from groundstation.detection import chan_vese
from groundstation.detection.config import DetectionConfig, DetectorKind
from groundstation.detection.detector import Detector
from groundstation.detection.local_fitting import evolve_local
from groundstation.detection.roi import place_roi
from groundstation.experiments.detection_plots import draw_cost
from groundstation.experiments.detector_outcomes import segmentation_input
from groundstation.experiments.tables import Cell, ResultTable
from groundstation.experiments.truth_scenes import scenes
from groundstation.session import Session, load_session
from groundstation.tracking.warm_up import warm_up

ROOT = Path(__file__).resolve().parent.parent
CONFIG = DetectionConfig(roi_sigmas=0.0)
LEVEL_SET = CONFIG.level_set
WEIGHTS = (LEVEL_SET.mu, LEVEL_SET.nu, LEVEL_SET.lambda1, LEVEL_SET.lambda2)
STOP = (LEVEL_SET.iterations, LEVEL_SET.stop_fraction, LEVEL_SET.stop_after)
SEED, EPOCHS = 11, (20, 120, 220, 270, 300)
RADII_PX = (5, 7, 10, 14, 20, 28, 40)
REGIONS_PX = ((125, 50), (250, 100), (375, 150), (500, 200), (750, 300), (1000, 400))
ALIKE, MOST_ITERATIONS = 0.99, 800
CONTOUR = np.float32(1e-3)  # height of the step of φ at a start contour; a higher one takes longer to change sides
# uneven light: where the contrast is a tenth of u's range, the usual length weight would outweigh it
UNEVEN_WEIGHTS, UNEVEN_STOP = (0.002, 0.0, 1.0, 1.0), (300, 0.001, 2)
LIGHTS, SHARES = ((0.5, 0.5), (0.4, 0.6), (0.35, 0.65), (0.3, 0.7), (0.2, 0.7)), (0.0, 0.5, 1.0)
REPEATS, SLOW_REPEATS, PASSES = 60, 3, 2
# the full grid until no pixel changes side for so long: a small step would need 200 times as many to come as far
AT_REST = (LEVEL_SET.time_step, 5_000, 0.0, 400)

Float32Array = NDArray[np.float32]
Start = tuple[Float32Array, NDArray[np.bool_]]
Advance = Callable[[Float32Array, Float32Array, int], Float32Array]


def median_ms(work: Callable[[Float32Array], Any], phi: Float32Array, repeats: int) -> float:
    """Return the median processor time of ``work`` on fresh copies of a level set."""
    spent = []
    for _ in range(repeats):
        own = phi.copy()
        started = time.thread_time()
        work(own)
        spent.append(time.thread_time() - started)
    return 1e3 * float(np.median(spent))


def band(u: Float32Array, phi: Float32Array) -> int:
    """Evolve the narrow band in place as the detector does; returns the iterations."""
    return int(chan_vese.evolve(u, phi, WEIGHTS, LEVEL_SET.eps, LEVEL_SET.time_step, *STOP))


def grid(u: Float32Array, phi: Float32Array, iterations: int) -> Float32Array:
    """Evolve the full grid so many iterations, without a rule."""
    chan_vese.evolve_full(u, phi, WEIGHTS, LEVEL_SET.eps, LEVEL_SET.time_step, iterations, -1.0, 1)
    return phi


def skimage(u: Float32Array, phi: Float32Array, iterations: int) -> Float32Array:
    """Run scikit-image's so many iterations with the same weights and step; its δ lacks the factor 1/π."""
    numbers = {
        "mu": LEVEL_SET.mu,
        "lambda1": LEVEL_SET.lambda1,
        "lambda2": LEVEL_SET.lambda2,
        "tol": 0.0,
    }
    step = LEVEL_SET.time_step / math.pi
    result = skimage_chan_vese(u, dt=step, max_num_iter=iterations, init_level_set=phi, extended_output=True, **numbers)
    return np.asarray(result[1], np.float32)


def iterations_of(advance: Advance, u: Float32Array, phi: Float32Array, rest: Float32Array) -> tuple[int, float, int]:
    """Return when the rule ends a level set, its similarity then to ``rest``, and when it is similar by 0.99.

    One iteration at a time; the rule is that of `LevelSetConfig`, the limit for the last `MOST_ITERATIONS`.
    """
    quiet, ended, alike_then, phi = 0, 0, 0.0, phi.copy()
    for done in range(1, MOST_ITERATIONS + 1):
        before = phi > 0
        phi = advance(u, phi, 1)
        alike = overlap(phi, rest)
        changed = np.count_nonzero((phi > 0) != before)
        quiet = quiet + 1 if changed <= LEVEL_SET.stop_fraction * np.count_nonzero(phi > 0) else 0
        if not ended and (quiet >= LEVEL_SET.stop_after or done == LEVEL_SET.iterations):
            ended, alike_then = done, alike
        if ended and alike >= ALIKE:
            return ended, alike_then, done
    return ended, alike_then, MOST_ITERATIONS


def overlap(a: Float32Array, b: Float32Array) -> float:
    """Return intersection over union of two level sets' insides."""
    return float(np.count_nonzero((a > 0) & (b > 0)) / max(np.count_nonzero((a > 0) | (b > 0)), 1))


def disc(size: tuple[int, int], radius: float) -> Start:
    """Return a blurred, slightly noisy disc in the middle of a (w, h) region, and the inside of a displaced start."""
    w, h = size
    y, x = np.mgrid[0:h, 0:w]
    away = np.hypot(x - w / 2, y - h / 2)
    noise = np.random.default_rng([SEED, w, h]).normal(0, 0.02, (h, w))
    u = np.clip(0.5 - 0.4 * np.tanh((away - radius) / 1.4) + noise, 0, 1).astype(np.float32)
    return u, np.hypot(x - w / 2 - 0.2 * radius, y - h / 2) < radius


def real_starts(session: Session) -> dict[str, Start]:
    """Return the initial input of a detector's segmentation in some 250 × 100 px regions of the session."""
    found: dict[str, Start] = {}
    station = session.rig.names[0]
    for scene in scenes(session, SEED, last_epoch=max(EPOCHS)):
        if scene.frame.station == station and scene.frame.epoch in EPOCHS:
            name = f"{session.name}, {scene.frame.t_s:.1f} s, {scene.background}, {scene.silhouette.width_px} px wide"
            start = segmentation_input(scene, CONFIG, region(scene.hint.predicted_px, scene.frame.image.whole().shape))
            if start is None:
                print(f"{name}: nothing to divide at first sight, left out", file=sys.stderr)
            else:
                found[name] = start
    return found


def region(predicted_px: NDArray[np.float64], shape: tuple[int, ...]) -> Box[int]:
    """Return the region of exactly 250 × 100 px around a prediction."""
    roi = place_roi(predicted_px, np.zeros((2, 2)), None, CONFIG, (shape[1], shape[0]))
    if roi is None:
        raise ValueError("the prediction lies outside the image")
    return roi


def compare(starts: dict[str, Start]) -> ResultTable:
    """Return times and overlaps of the level sets on each region, from both starts."""
    rows: list[list[Cell]] = []
    for region_name, (u, inside) in starts.items():
        stepped = chan_vese.start(u, inside)
        contour = np.where(inside, CONTOUR, -CONTOUR)
        rest = stepped.copy()
        settled = chan_vese.evolve_full(u, rest, WEIGHTS, LEVEL_SET.eps, *AT_REST) < AT_REST[1]
        name = region_name if settled else f"{region_name} (the full grid did not come to rest)"
        ours = stepped.copy()
        done = band(u, ours)
        same = median_ms(lambda own, u=u: band(u, own), stepped, REPEATS)
        whole = median_ms(lambda _, u=u, inside=inside: band(u, chan_vese.start(u, inside)), stepped, REPEATS)
        for start, phi, ms in (("after its first step", stepped, same), ("contour", contour, whole)):
            rows.append([name, start, "narrow band", done, ms, None, overlap(ours, rest), None, None, None])
            for method, advance in (("full grid", grid), ("scikit-image", skimage)):
                ended, alike, equal = iterations_of(advance, u, phi, rest)
                times = [
                    median_ms(lambda own, u=u, n=n, advance=advance: advance(u, own, n), phi, SLOW_REPEATS)
                    for n in (ended, equal)
                ]
                reached: list[Cell] = [equal if equal < MOST_ITERATIONS else f"over {MOST_ITERATIONS}"]
                rows.append(
                    [name, start, method, ended, times[0], times[0] / ms, alike, *reached, times[1], times[1] / ms]
                )
    return ResultTable(
        name="level_sets",
        title="Level sets from the same start with the same rule for stopping",
        columns=(
            *("region", "start", "level set", "iterations by the rule", "ms", "over the band's", "IoU with rest then"),
            *("iterations to IoU 0.99", "ms to that", "over the band's, to that"),
        ),
        rows=rows,
        notes=(
            "Targets: scikit-image at least 50 × the band's time, IoU of the band at least 0.99. Rest: the full grid "
            f"with time step {AT_REST[0]:g} (the band's own) until no pixel changes side in {AT_REST[3]} iterations. "
            "Starts: the level set after the band's first, unbounded data step; or the contour itself, where the "
            f"band's time holds that first step. The rule: at most {100 * STOP[1]:g} % of the pixels inside change "
            f"side, {STOP[2]} times running (the band asks more: that φ rests near the contour, whose pixels then go "
            "where they rest). scikit-image does not know the rule; it is given the number of iterations after which "
            "it would have ended, in one call. Times are processor time of one thread.",
        ),
    )


def cost() -> tuple[ResultTable, dict[str, tuple[list[float], list[float]]]]:
    """Return the table of times against length and size, and the two curves."""
    curves: dict[str, tuple[list[float], list[float]]] = {}
    rows: list[list[Any]] = []
    cases = {
        "contour's length, px": [((250, 100), r, 2 * math.pi * r) for r in RADII_PX],
        "region's size, px²": [(size, 14, float(size[0] * size[1])) for size in REGIONS_PX],
    }
    for name, sizes in cases.items():
        lengths, times = [], []
        for size, radius, length in sizes:
            u, inside = disc(size, radius)
            phi = chan_vese.start(u, inside)
            lengths.append(length)
            times.append(median_ms(lambda own, u=u: band(u, own), phi, REPEATS))
            rows.append([name, f"{size[0]}×{size[1]}", radius, length, band(u, phi.copy()), times[-1], None])
        exponent = float(np.polyfit(np.log(lengths), np.log(times), 1)[0])
        rows.append([f"exponent of time against the {name.split(',')[0]}", "", "", "", "", None, exponent])
        curves[name] = (lengths, times)
    table = ResultTable(
        name="cost",
        title="What the narrow band costs",
        columns=("against", "region", "radius px", "length or size", "iterations", "ms", "exponent"),
        rows=rows,
        notes=("Target: exponent against the contour's length at most 1.",),
    )
    return table, curves


def uneven_light() -> ResultTable:
    """Return how well a drawn target is divided from light that changes across the picture, by both fittings."""
    w, h = 250, 100
    y, x = np.mgrid[0:h, 0:w]
    target = np.hypot((x - 125) / 2.0, y - 50) < 10
    inside = np.hypot((x - 129) / 2.2, y - 48) < 12
    start = np.where(inside, np.float32(1), np.float32(-1)).astype(np.float32)
    rows: list[list[Cell]] = []
    for darkest, brightest in LIGHTS:
        rng = np.random.default_rng(SEED)
        light = np.linspace(darkest, brightest, w)[None, :]
        u = np.clip(light * np.where(target, 1.4, 1.0) + rng.normal(0, 0.01, (h, w)), 0, 1).astype(np.float32)
        for share in SHARES:

            def divide(phi: Float32Array, u: Float32Array = u, share: float = share) -> Float32Array:
                if share > 0:
                    local = (share, LEVEL_SET.local_sigma_px)
                    evolve_local(u, phi, UNEVEN_WEIGHTS, local, LEVEL_SET.eps, LEVEL_SET.time_step, *UNEVEN_STOP)
                else:
                    chan_vese.evolve(u, phi, UNEVEN_WEIGHTS, LEVEL_SET.eps, LEVEL_SET.time_step, *UNEVEN_STOP)
                return phi

            alike = overlap(divide(start.copy()), np.where(target, 1, -1).astype(np.float32))
            rows.append([f"{brightest / darkest:.1f}", share, alike, median_ms(divide, start, 10)])
    return ResultTable(
        name="uneven_light",
        title="Global and local fitting under uneven light",
        columns=("light, right over left", "local share", "IoU with the drawn target", "ms"),
        rows=rows,
        notes=(
            "A target 1.4 times as bright as what is behind it, noise 0.01, no flattening before; "
            f"μ = {UNEVEN_WEIGHTS[0]:g}, σ = {LEVEL_SET.local_sigma_px:g} px, the same start contour.",
        ),
    )


def detector_times(session: Session) -> ResultTable:
    """Return the times of the whole detector in regions of 250 × 100 px."""
    spent: dict[str, list[float]] = {}
    for _ in range(PASSES):
        detectors: dict[str, Detector] = {}
        for scene in scenes(session, SEED):
            image, name = scene.frame.image.whole(), scene.frame.station
            detector = detectors.setdefault(name, Detector(CONFIG, (image.shape[1], image.shape[0])))
            roi = region(scene.hint.predicted_px, image.shape)
            started = time.thread_time()
            detector.detect(image, roi, scene.hint)
            elapsed = time.thread_time() - started
            for group in ("all", scene.background):
                spent.setdefault(group, []).append(1e3 * elapsed)
    rows = [
        [name, len(ms), float(np.median(ms)), float(np.percentile(ms, 99)), float(np.max(ms))]
        for name, ms in spent.items()
    ]
    return ResultTable(
        name="detector",
        title="The whole detector in 250 × 100 px",
        columns=("background", "looks", "ms median", "99 %", "worst"),
        rows=rows,
        notes=("Targets: median at most 1 ms, 99 % at most 3 ms.",),
    )


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("session", type=Path, nargs="?")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "level-set-speed")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    warm_up(DetectorKind.CLASSIC)
    u, inside = disc((40, 30), 8.0)
    grid(u, chan_vese.start(u, inside), 2)  # compiled before it is timed
    session = load_session(options.session or ROOT / "recordings" / "landing-1")
    costs, curves = cost()
    made_up = {"made-up disc, 14 px radius": disc((250, 100), 14.0)}
    tables = [compare(real_starts(session) | made_up), costs, detector_times(session), uneven_light()]
    options.out.mkdir(parents=True, exist_ok=True)
    for table in tables:
        print(table.markdown())
        table.write_csv(options.out)
    text = "# Speed of the level set\n\n" + "\n".join(table.markdown() for table in tables)
    (options.out / "tables.md").write_text(text, encoding="utf-8")
    draw_cost(curves, options.out / "cost.png")
    print(f"wrote {options.out}")


if __name__ == "__main__":
    main()
