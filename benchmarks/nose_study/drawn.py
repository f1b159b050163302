"""One drawn approach of benchmarks/nose_bank.py: rendered, tracked as `onboard edges` does, against its truth."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from groundstation.arrays import ImageArray
from groundstation.onboard.edges.config import config_by_poses
from groundstation.onboard.edges.lines import crossings_at, line_map, project_lines
from groundstation.onboard.edges.pose import Attitude, NoseCameraPose, nose_pose
from groundstation.onboard.edges.pose_drift import NO_DRIFT, PoseDrift
from groundstation.onboard.edges.search_band import NoBand, RunwayGuess, band_rows
from groundstation.onboard.edges.tracker import EdgeTracker
from groundstation.onboard.edges.undistortion import Undistorter
from groundstation.onboard.edges.visual_odometry import VisualOdometry
from groundstation.onboard.scenes.draw_nose_world import NoseWorld, draw_nose_world, reported_poses
from groundstation.onboard.scenes.ground import Strip
from groundstation.onboard.scenes.sequences import Renderer

Array = NDArray[np.float64]
# the runway is seen where so many rows show it
_LEAST_ROWS = 8.0
# bands on both sides of an edge that are compared, m from it, and their least width and distance, px
_INSIDE_M, _OUTSIDE_M, _LEAST_PX = (1.3, 3.8), (3.6, 6.1), 2.0
_ROWS_A_BLOCK = 6
# reflectance of a shoulder over the runway's
_SHOULDER = 0.8


def scored_world(job: dict[str, Any]) -> dict[str, Any]:
    """Return what comes of one seed, as JSON has it: factors, and of each picture in which the runway is seen a row.

    A row: status, why there was no measurement, errors (4,) and stated sigmas (4,) px of the ends or none, NEES over 4,
    and the contrast of the fainter edge over the pixels' scatter.
    """
    cv2.setNumThreads(1)
    world = draw_nose_world(job["seed"], job["pictures"])
    if job.get("shoulders_m"):
        world = shouldered(world, job["shoulders_m"])
    flight, field = world.flight, world.flight.sequence.airfield
    flat = Undistorter(flight.setup.lens)
    guess = RunwayGuess(width_m=world.announced_m, length_m=field.length_m)
    config = config_by_poses(guess, world.noise if world.poses else None)
    tracker = EdgeTracker(flat.kappa, flight.setup.lens.image_size_px, config)
    poses, renderer, rows = _poses(world, flat.kappa), Renderer(flight.sequence, flight.setup.lens), []
    lines = np.array([1.0, 0.0, -0.5 * field.width_m, 0.5 * field.width_m])
    for number, sample in enumerate(flight.frames):
        truth = flight.pose(sample)
        image = flat.flat(renderer.picture(truth, sample))
        report, e = tracker.step(image, *poses(number, image)), line_map(truth, flat.kappa)
        size = flight.setup.lens.image_size_px
        band = band_rows(
            truth,
            flat.kappa,
            size,
            RunwayGuess(width_m=field.width_m, length_m=field.length_m, margin_m=0.5, margin_px=0.0),
        )
        if isinstance(band, NoBand) or band[1] - band[0] < _LEAST_ROWS:
            continue
        row: dict[str, Any] = {"picture": number, "status": report.status.value, "miss": report.miss.value}
        row["contrast"] = contrast(image, project_lines(lines, e, band)[0], band, field.width_m)
        if report.edges is not None:
            off = report.edges.crossings_px - project_lines(lines, e, report.edges.rows_px)[0]
            covariance = report.edges.covariance_px2
            row["errors"], row["sigmas"] = off.tolist(), np.sqrt(np.diag(covariance)).tolist()
            row["nees"] = float(off @ np.linalg.solve(covariance, off)) / 4.0
        rows.append(row)
    return {"seed": job["seed"], "factors": world.factors, "rows": rows}


def shouldered(world: NoseWorld, width_m: float) -> NoseWorld:
    """Return an approach whose runway has paved shoulders of this width at both sides, a fifth darker than itself."""
    sequence = world.flight.sequence
    field = sequence.airfield
    colour = tuple(float(_SHOULDER * part) for part in field.surfaces.runway)
    strips = tuple(
        Strip(
            x_m=side * 0.5 * (field.width_m + width_m), y_m=-0.5 * field.length_m, turn_rad=0.0,
            width_m=width_m, length_m=field.length_m, colour=(colour[0], colour[1], colour[2]), mottle=0.08,
        )
        for side in (-1.0, 1.0)
    )  # fmt: skip
    sequence = replace(sequence, airfield=replace(field, strips=(*field.strips, *strips)))
    return replace(world, flight=replace(world.flight, sequence=sequence))


def _poses(world: NoseWorld, kappa: Array) -> Callable[[int, ImageArray], tuple[NoseCameraPose, PoseDrift]]:
    """Return the pose of a picture by its number, as the navigation has it, or by the pictures' own motion."""
    attitude, place = reported_poses(world)
    own = [
        nose_pose(at, Attitude(roll_rad=float(a[0]), pitch_rad=float(a[1]), yaw_rad=float(a[2])), world.mount)
        for at, a in zip(place[world.flight.frames], attitude[world.flight.frames], strict=True)
    ]
    if world.poses:
        return lambda number, image: (own[number], NO_DRIFT)
    odometry, t_s = VisualOdometry(kappa, own[0]), world.flight.motion.t_s[world.flight.frames]

    def by_motion(number: int, image: ImageArray) -> tuple[NoseCameraPose, PoseDrift]:
        step = odometry.step(float(t_s[number]), image)
        return step.pose, PoseDrift(new_turn_rad=step.turn_rad, new_shift_m=step.shift_m)

    return by_motion


def contrast(image: ImageArray, crossings_px: Array, rows_px: Array, width_m: float) -> float:
    """Return the contrast of the fainter edge: of bands on both sides, over the scatter of their pixels.

    Of each block of rows the difference of both means over the root of the mean variance, root mean square of the
    colours; of an edge the median of its blocks.
    """
    found = []
    first, last = int(np.ceil(max(rows_px[0], 0.0))), int(np.floor(min(rows_px[1], image.shape[0] - 1.0)))
    for line in range(2):
        blocks = []
        for top in range(first, last + 1, _ROWS_A_BLOCK):
            bands: tuple[list[Array], list[Array]] = ([], [])
            for row in range(top, min(top + _ROWS_A_BLOCK, last + 1)):
                left, _, right, _ = crossings_at(crossings_px, rows_px, np.array([row, row + 1.0]))
                px_per_m, outwards = (right - left) / width_m, -1.0 if line == 0 else 1.0
                edge = left if line == 0 else right
                for band, (near_m, far_m), sign in ((0, _INSIDE_M, -outwards), (1, _OUTSIDE_M, outwards)):
                    near = max(near_m * px_per_m, _LEAST_PX)
                    ends = sorted((edge + sign * near, edge + sign * max(far_m * px_per_m, near + _LEAST_PX)))
                    low, high = max(int(np.ceil(ends[0])), 0), min(int(np.floor(ends[1])) + 1, image.shape[1])
                    bands[band].append(image[row, low : max(high, low)].astype(np.float64))
            inside, outside = (np.concatenate(band) for band in bands)
            if min(len(inside), len(outside)) >= _ROWS_A_BLOCK:
                scatter = np.sqrt(0.5 * (inside.var(axis=0) + outside.var(axis=0)) + 1.0)
                blocks.append(np.sqrt(np.mean(((inside.mean(axis=0) - outside.mean(axis=0)) / scatter) ** 2)))
        found.append(float(np.median(blocks)) if blocks else 0.0)
    return min(found)
