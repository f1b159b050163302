"""Consistency of the pose's covariance over corner noise, and of corners taken from pictures."""

import cv2
import numpy as np
from scipy.stats import chi2

from groundstation.geometry.rotation import (
    matrix_from_wxyz,
    rotation_from_vector,
    rotation_x,
    rotation_y,
    rotation_z,
    wxyz_from_matrix,
)
from groundstation.onboard.pose.corners import refine_corners
from groundstation.onboard.pose.inertial_filter import rotation_vector
from groundstation.onboard.pose.pose_solver import KnownAttitude, pose_covariance, solve_pose
from groundstation.onboard.pose.simulated_approach import RUNWAY_FROM_LEVEL_BODY, default_setup, see_runway
from groundstation.onboard.pose.susan import susan_corner


def somewhere(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Position (3,) and runway_from_body (3, 3) on a sloppy approach, 150 to 1800 m out."""
    away, glide = rng.uniform(150, 1800), np.radians(rng.uniform(2.5, 6.0))
    position = np.array([rng.normal(0, 0.02) * away, away * np.cos(glide), away * np.sin(glide)])
    yaw, pitch, roll = np.radians([rng.normal(0, 3), rng.normal(0, 2), rng.normal(0, 8)])
    return position, RUNWAY_FROM_LEVEL_BODY @ rotation_z(yaw) @ rotation_y(pitch) @ rotation_x(roll)


def noise_study(count: int = 5000) -> dict[str, object]:
    """NEES of the pose by corner noise; the covariance as shipped, at the estimate, and at the true pose."""
    out: dict[str, object] = {}
    for sigma_px in (0.3, 0.5, 1.0):
        setup = default_setup(sigma_px)
        rng = np.random.default_rng([7, int(10 * sigma_px)])
        shipped, at_truth, misfit = [], [], []
        while len(shipped) < count:
            position, body = somewhere(rng)
            seen = see_runway(setup, position, body, rng)
            if seen is None:
                continue
            camera = position + body @ setup.mount.camera_in_body_m
            R = body @ setup.mount.body_from_camera
            pose = solve_pose(seen)
            e = np.concatenate(
                [camera - pose.position_m, rotation_vector(R @ matrix_from_wxyz(pose.runway_from_camera_wxyz).T)]
            )
            shipped.append(e @ np.linalg.solve(pose.covariance, e))
            at_truth.append(e @ np.linalg.solve(pose_covariance(seen, camera, wxyz_from_matrix(R)), e))
            misfit.append(pose.chi_square)
        low, high = chi2.ppf([0.025, 0.975], 6 * count) / count
        out[f"{sigma_px} px"] = {
            "nees": round(float(np.mean(shipped)), 3),
            "nees_covariance_at_truth": round(float(np.mean(at_truth)), 3),
            "band_95": [round(float(low), 3), round(float(high), 3)],
            "cost_of_2": round(float(np.mean(misfit)), 3),
        }
    return out


def horizon_study(count: int = 1500) -> dict[str, object]:
    """RMSE of range for a small UAV's camera (runway 900 m by 30 m, 0.5 px), the horizon known to so much."""
    setup = default_setup(0.5)
    rng = np.random.default_rng(21)
    sigmas_deg = (0.02, 0.1, 0.5)
    rows = []
    while len(rows) < count:
        position, body = somewhere(rng)
        seen = see_runway(setup, position, body, rng)
        if seen is None:
            continue
        camera = position + body @ setup.mount.camera_in_body_m
        R = body @ setup.mount.body_from_camera
        range_m = float(np.linalg.norm(camera))
        errors = [solve_pose(seen).range_m - range_m]
        noise = rng.standard_normal(3)
        for degrees in sigmas_deg:
            sigma = np.radians([degrees, degrees, np.inf])
            turn = np.array([*(sigma[:2] * noise[:2]), 0.1 * noise[2]])
            measured = wxyz_from_matrix(rotation_from_vector(turn) @ R)
            known = KnownAttitude(runway_from_camera_wxyz=measured, sigma_rad=sigma)
            errors.append(solve_pose(seen, known).range_m - range_m)
        rows.append([range_m, *errors])
    table = np.array(rows)
    out: dict[str, object] = {}
    for low, high in ((150, 500), (500, 1000), (1000, 1800)):
        part = table[(table[:, 0] >= low) & (table[:, 0] < high), 1:]
        names = ("nothing", *(f"horizon {degrees} deg" for degrees in sigmas_deg))
        out[f"{low}-{high} m"] = dict(zip(names, np.sqrt((part**2).mean(axis=0)).round(2).tolist(), strict=True))
    return out


def extraction_study(count: int = 100) -> dict[str, object]:
    """Distance of extracted corners from the true ones in drawn pictures with blur and noise, started 3 px off."""
    rng = np.random.default_rng(3)
    shape = np.array([[70.3, 190.6], [133.2, 61.4], [160.7, 62.1], [240.4, 195.2]])
    fine, coarse, squares = [], [], []
    v, u = np.mgrid[0:256, 0:320].astype(float)
    for _ in range(count):
        true = shape + rng.uniform(-4, 4, 2) + rng.uniform(-3, 3, (4, 2))
        inside = np.full(u.shape, np.inf)
        for start, end in zip(true, np.roll(true, -1, axis=0), strict=True):
            along = (end - start) / np.linalg.norm(end - start)
            inside = np.minimum(inside, along[0] * (v - start[1]) - along[1] * (u - start[0]))
        image = cv2.GaussianBlur(70 + 100 * np.clip(0.5 + inside, 0, 1), (0, 0), 0.7)
        image = image + 3.0 * rng.standard_normal(image.shape)
        first = true + rng.uniform(-3, 3, (4, 2))
        found = refine_corners(image, first)
        if found is not None:
            e = found.pixels - true
            fine.append(np.linalg.norm(e, axis=1))
            squares += [float(d @ np.linalg.solve(P, d)) / 2 for d, P in zip(e, found.covariance_px2, strict=True)]
        for corner, near in zip(true, first, strict=True):
            susan = susan_corner(image, near, 7, 25.0)
            if susan is not None:
                coarse.append(float(np.linalg.norm(susan - corner)))
    return {
        "pictures": count,
        "sides_found": len(fine) / count,
        "sides_rms_px": round(float(np.sqrt(np.mean(np.square(fine)))), 4),
        "sides_normalised_square": round(float(np.mean(squares)), 2),
        "susan_found": len(coarse) / (4 * count),
        "susan_median_px": round(float(np.median(coarse)), 2),
        "susan_rms_px": round(float(np.sqrt(np.mean(np.square(coarse)))), 2),
    }
