"""Segmentation energies started from displaced lines, and open-loop predictions of the edges."""

import numpy as np

from groundstation.experiments.onboard_energies import band_px
from groundstation.onboard.edges.gradient_descent import DescentConfig, Energy, descend
from groundstation.onboard.edges.kalman import picture_crossings, picture_state, predict_picture, update_picture
from groundstation.onboard.edges.lines import crossings_at, line_map, project_lines
from groundstation.onboard.edges.pose import NoseCameraPose
from groundstation.onboard.edges.search_band import across_direction
from groundstation.onboard.edges.visual_odometry import VisualOdometry
from groundstation.onboard.scenes.sequences import NoseFrame, Sequence
from onboard_edges_study.methods import KAPPA, LOST_PX, Array, certain_truth, truth


def compare_energies(sequence: Sequence, frames: list[NoseFrame]) -> dict[tuple[str, float], Array]:
    """Return errors (n, 4) px after going down from lines that are off by 2, 4 and 8 px, of every third frame."""
    found: dict[tuple[str, float], list[Array]] = {}
    for off_px in (2.0, 4.0, 8.0):
        draw_off = np.random.default_rng([sequence.seed, int(off_px)])
        for frame in frames[::3]:
            seen = truth(sequence, frame.truth)
            if seen is None:
                continue
            rows, wanted = seen
            start = wanted + np.repeat(draw_off.normal(0.0, off_px, 2), 2) + draw_off.normal(0.0, 1.0, 4)
            if min(start[2] - start[0], start[3] - start[1]) < 3.0:
                continue
            widths = np.repeat(band_px(frame, rows)[None, :], 2, axis=0)
            across = across_direction(line_map(frame.reported, KAPPA))
            for name, energy, along in (
                ("variant, bands across", Energy.SPATIALLY_VARIANT, across),
                ("variant, normals", Energy.SPATIALLY_VARIANT, None),
                ("non-variant", Energy.NON_VARIANT, None),
            ):
                config = DescentConfig(energy=energy, gamma=1e-3, adaptive_gamma=False)
                end = descend(frame.image, start, rows, widths, config, along).crossings_px
                found.setdefault((name, off_px), []).append(np.clip(end - wanted, -LOST_PX, LOST_PX))
    return {key: np.array(values) for key, values in found.items()}


def prediction(sequence: Sequence, frames: list[NoseFrame]) -> dict[str, Array]:
    """Return the RMSE (n,) px of predictions that no measurement corrects after the first second."""
    start = round(sequence.approach.rate_hz)
    field = sequence.airfield
    lines = np.array([1.0, 0.0, -0.5 * field.width_m, 0.5 * field.width_m])
    rows, crossings = certain_truth(sequence, frames[0].truth)
    flat = picture_state(crossings, rows, 240.0, np.array([100.0, 1.0]))
    odometry = VisualOdometry(KAPPA, frames[start].truth)
    found: dict[str, list[float]] = {"3-D, IMU": [], "3-D, pictures": [], "2-D, constant velocity": [], "2-D, held": []}
    held, wanted = (crossings, rows), crossings
    # the IMU's constant errors are known from the tracked second before: only the part after it is compared
    turn = frames[start].reported.threshold_from_camera.T @ frames[start].truth.threshold_from_camera
    shift = frames[start].truth.camera_threshold_m - frames[start].reported.camera_threshold_m
    for k, frame in enumerate(frames):
        there = truth(sequence, frame.truth)
        # where the runway is invisible, its last visible edges are compared
        rows, wanted = there or (rows, wanted)
        if k:
            flat = predict_picture(flat, frame.t_s - frames[k - 1].t_s, np.array([500.0, 0.05]))
        if k <= start:
            flat = update_picture(flat, wanted, rows, 0.01 * np.eye(4))
            held = wanted, rows
        if k < start:
            continue
        imu = NoseCameraPose(
            threshold_from_camera=frame.reported.threshold_from_camera @ turn,
            camera_threshold_m=frame.reported.camera_threshold_m + shift,
        )
        seen = odometry.step(frame.t_s, frame.image).pose
        for name, crossings in (
            ("3-D, IMU", project_lines(lines, line_map(imu, KAPPA), rows)[0]),
            ("3-D, pictures", project_lines(lines, line_map(seen, KAPPA), rows)[0]),
            ("2-D, constant velocity", picture_crossings(flat, rows)),
            ("2-D, held", crossings_at(*held, rows)),
        ):
            off = np.clip(crossings - wanted, -LOST_PX, LOST_PX)
            found[name].append(float(np.sqrt(np.mean(off**2))))
    return {name: np.array(values) for name, values in found.items()}
