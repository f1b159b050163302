"""The quality of a lens calibration, and the next steps, in words."""

from dataclasses import dataclass

import numpy as np

from calibration.lens.intrinsics import Intrinsics
from groundstation.arrays import FloatArray

# a usual pan-tilt unit's step: a lens that is known better does not limit such a station
PTU_STEP_DEG = 0.00625
# the error across that a landing can bear from this source alone
ACROSS_M = 0.05
BASELINE_M = 10.0
RANGES_M = (100.0, 200.0, 500.0, 1000.0)
_BORDER = 0.15
_PLACES = (("upper left", "top", "upper right"), ("left", "middle", "right"), ("lower left", "bottom", "lower right"))
_FEW_HERE = 12
_STRONG = 0.95
# the middle of the image is the part without this share on each side
_OUTSIDE_MIDDLE = 0.2
_WORDS = ((0.003, "Very good"), (0.01, "Good"), (0.03, "Usable"))


@dataclass(frozen=True, slots=True, kw_only=True)
class LensAdvice:
    """The ``verdict`` in a sentence or two; ``notes`` on the result; ``next_steps``, most useful first."""

    verdict: str
    notes: tuple[str, ...]
    next_steps: tuple[str, ...]


def middle_angle_deg(found: Intrinsics) -> float:
    """Return the largest one-sigma angle in the middle of the image, where a turning station keeps the aircraft."""
    angles = found.map.aligned_deg
    rows, columns = (round(_OUTSIDE_MIDDLE * n) for n in angles.shape)
    return float(angles[rows : angles.shape[0] - rows, columns : angles.shape[1] - columns].max())


def across_m(angle_deg: float, range_m: float) -> float:
    """Return the error across the line of sight, m."""
    return range_m * float(np.radians(angle_deg))


def along_m(angle_deg: float, range_m: float, baseline_m: float = BASELINE_M) -> float:
    """Return the error along the line of sight of two such cameras, independent of each other, m."""
    return range_m**2 * float(np.sqrt(2.0) * np.radians(angle_deg)) / baseline_m


def tilts_deg(found: Intrinsics) -> FloatArray:
    """Return the angle (views,) between each board and the image plane: what makes near and far on one board."""
    tilts = []
    for rotation in found.fit.rotation:
        # Rodrigues' formula for the z axis's own part
        angle = float(np.linalg.norm(rotation))
        along = float(rotation[2]) / angle if angle > 0 else 1.0
        facing = np.cos(angle) + along**2 * (1.0 - np.cos(angle))
        tilts.append(float(np.degrees(np.arccos(min(1.0, abs(facing))))))
    return np.array(tilts)


def advise(found: Intrinsics) -> LensAdvice:
    """Evaluate a calibration and state how to improve it."""
    angle = middle_angle_deg(found)
    reach = ACROSS_M / float(np.radians(angle)) if angle > 0 else float("inf")
    word = next((word for limit, word in _WORDS if angle <= limit), "Not good enough")
    than = "less" if angle < PTU_STEP_DEG else "more"
    verdict = (
        f"{word}: in the middle of the image the lens is known to {angle:.2g}° (1 σ, camera's orientation found with "
        f"it), {than} than a pan-tilt step of {PTU_STEP_DEG}°; in the corners to {found.map.aligned_deg.max():.2g}°. "
        f"Across, the middle's stays below {ACROSS_M:g} m up to {_rounded(reach)} m; at 500 m it is "
        f"{across_m(angle, 500):.2g} m across and {along_m(angle, 500):.2g} m along for two such cameras "
        f"{BASELINE_M:g} m apart."
    )
    return LensAdvice(verdict=verdict, notes=tuple(_notes(found)), next_steps=tuple(_next_steps(found, angle)))


def _rounded(value: float) -> str:
    return "any number of" if not np.isfinite(value) else f"{float(f'{value:.2g}'):.0f}"


def _notes(found: Intrinsics) -> list[str]:
    fit, held = found.fit, found.held_out
    notes = [
        f"Held-out error {held.rms_px:.3f} px (each view by lenses fitted without it, {held.folds} parts); fitted "
        f"{fit.rms_px:.3f} px; one coordinate of a corner is good to {fit.sigma_px:.3f} px."
    ]
    rho = fit.focal_distance_correlation
    part = 100 * float(np.max(fit.sigma[:2] / fit.lens.focal_px))
    tell = "cannot distinguish" if abs(rho) > _STRONG else "distinguish"
    notes.append(
        f"Focal length and the boards' distance correlate by {rho:+.4f}: these views {tell} a longer lens and a "
        f"nearer board well; the focal length is known to {part:.2g} %."
    )
    free = fit.sigma > 0
    ratio = fit.sigma[free] / np.where(fit.opencv_sigma[free] > 0, fit.opencv_sigma[free], np.nan)
    if np.all(np.abs(ratio - 1.0) < 0.05):
        notes.append("OpenCV's own standard deviations agree within 5 %.")
    elif np.all(ratio > 0.95):
        notes.append(
            f"Sigmas are up to {np.nanmax(ratio):.1f} times OpenCV's, which takes each corner's error as new: within a "
            "view, errors go together."
        )
    else:
        notes.append("OpenCV's own standard deviations differ by more than 5 %: its solver stopped early on this lens.")
    if found.held_out_without_k3_px is not None:
        k3, sigma = fit.lens.distortion[4], fit.sigma[8]
        notes.append(
            f"k3 = {k3:.3g} ± {sigma:.2g} cannot be told from zero; without it the held-out error is "
            f"{found.held_out_without_k3_px:.3f} px."
        )
    return notes


def corners_by_place(found: Intrinsics) -> dict[str, int]:
    """Return how many corners were seen in the middle and along each border and corner of the image."""
    pixel = np.vstack([view.pixel for view in found.views])
    part = pixel / np.array(found.fit.lens.image_size_px)
    column, row = (np.digitize(part[:, i], (_BORDER, 1.0 - _BORDER)) for i in (0, 1))
    return {_PLACES[r][c]: int(np.sum((row == r) & (column == c))) for r in range(3) for c in range(3)}


def _next_steps(found: Intrinsics, angle_deg: float) -> list[str]:
    """Return the next steps, the most useful first."""
    steps = []
    tilts = tilts_deg(found)
    steep = int(np.sum(tilts > 20.0))
    if steep < max(3, len(tilts) // 3):
        steps.append(f"More tilt: {steep} of {len(tilts)} boards are tilted by more than 20°; try 30 to 45°, all ways.")
    bare = [place for place, count in corners_by_place(found).items() if count < _FEW_HERE]
    if bare:
        steps.append(f"Fill the {_listed(bare)} of the image: almost no corner was seen there; boards may stick out.")
    distances = np.array([np.linalg.norm(t) for t in found.fit.translation_m])
    if distances.max() < 1.3 * distances.min():
        steps.append(f"Vary the distance: all boards are {distances.min():.2g} to {distances.max():.2g} m away.")
    if found.fit.focal_distance_correlation > _STRONG and found.held_out.rms_px < 1.0 and angle_deg > 0.003:
        steps.append("To part focal length from distance: steep boards that fill the image, at several depths.")
    if len(found.views) < 15:
        steps.append(f"More views: {len(found.views)} are used, 15 to 30 different ones average the noise.")
    if found.held_out.rms_px > 1.5 * found.fit.rms_px:
        steps.append("More views, or fewer coefficients (--hold k3): unseen views fit clearly worse than fitted ones.")
    if found.held_out_without_k3_px is not None and found.held_out_without_k3_px <= 1.02 * found.held_out.rms_px:
        steps.append("Try --hold k3: the sixth-order coefficient adds nothing but uncertainty at the image's border.")
    if found.fit.sigma_px > 0.5:
        steps.append("Hold board and camera still, with more light and a flat, stiff board: the corners are noisy.")
    return steps or ["Nothing is missing; check the lens again after the focus or zoom ring has been touched."]


def _listed(words: list[str]) -> str:
    return words[0] if len(words) == 1 else ", ".join(words[:-1]) + " and " + words[-1]
