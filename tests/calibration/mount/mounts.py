"""Made-up mounts: a head with every error, marks around it, and what its camera sees at a grid of angles."""

from dataclasses import dataclass, replace

import numpy as np

from calibration.mount.problem import Mark, MarkKind, MountSightings
from groundstation.geometry.aim import aim_at
from groundstation.geometry.calibration import CALIBRATION_PARAMETERS
from groundstation.geometry.camera import Lens
from groundstation.rig.ptu_axes import PtuAxes
from groundstation.rig.rig import ClockModel, Station

# tolerance of an aim anywhere: near the corners of the picture, with the boresight off by a degree
_CORNER = 1.1
STEP_DEG, NOISE_DEG, NOISE_PX = 0.00625, 0.01, 0.3


def plain_station(**changes: object) -> Station:
    """Return a station as a rig file describes it before calibration."""
    station = Station(
        name="left",
        fixed=False,
        known=("position", "orientation", "lens"),
        ptu_position_m=np.array([-5.0, 0.0, 1.6]),
        runway_from_base_wxyz=np.array([1.0, 0.0, 0.0, 0.0]),
        head_from_camera_wxyz=np.array([0.5**0.5, -(0.5**0.5), 0.0, 0.0]),
        camera_in_head_m=np.array([0.0, 0.06, 0.05]),
        lens=Lens(
            image_size_px=(1280, 960),
            focal_px=np.array([6680.0, 6682.0]),
            principal_point_px=np.array([645.0, 472.0]),
            distortion=np.array([-0.2, 0.6, 4e-4, -3e-4, 0.0]),
        ),
        ptu_resolution_rad=np.radians(STEP_DEG),
        ptu_sigma_rad=np.radians(NOISE_DEG),
        ptu_clock=ClockModel(),
        camera_clock=None,
        readout_s=0.0,
        covariance_parameters=(),
        covariance=np.zeros((0, 0)),
    )
    return replace(station, **changes)


def spoiled(station: Station, rng: np.random.Generator) -> Station:
    """Return a station as it truly may be: everything that `calibrate mount` finds is off."""
    change = np.zeros(21)
    for group, sigma in (
        ("runway_from_base", np.radians(0.3)),
        ("head_from_camera", np.radians(0.3)),
        ("camera_in_head", 0.01),
    ):
        for axis in "xyz":
            change[CALIBRATION_PARAMETERS.index(f"{group}.{axis}")] = sigma * rng.normal()
    axes = PtuAxes(
        pan_scale=3e-4 * rng.normal(),
        tilt_scale=3e-4 * rng.normal(),
        lean_rad=np.radians(0.05) * rng.normal(),
        pan_backlash_rad=np.radians(rng.uniform(0.0, 0.06)),
        tilt_backlash_rad=np.radians(rng.uniform(0.0, 0.06)),
    )
    return replace(station.changed(change), ptu_axes=axes)


def marks_around(
    station: Station,
    rng: np.random.Generator,
    count: int = 12,
    known: bool = True,
    tilts_deg: tuple[float, ...] = (-10.0, 10.0, 35.0, 58.0),
) -> tuple[Mark, ...]:
    """Return distant marks over pan ± 60° at these tilts, within 2°: three directions (stars, masts) for each point."""
    marks = []
    for k in range(count):
        pan = np.radians(-60.0 + 120.0 * (k + 0.5) / count)
        tilt = np.radians(tilts_deg[k % len(tilts_deg)] + rng.uniform(-2, 2))
        unit = np.array([-np.sin(pan) * np.cos(tilt), np.cos(pan) * np.cos(tilt), np.sin(tilt)])
        point = k % 4 == 0
        if point:
            kind = MarkKind.POINT if known else MarkKind.UNKNOWN_POINT
        else:
            kind = MarkKind.DIRECTION if known else MarkKind.UNKNOWN_DIRECTION
        place = station.ptu_position_m + rng.uniform(40, 120) * unit if point else unit
        sigma = np.full(3, 0.003 if point else 0.0)
        marks.append(Mark(name=f"m{k}", kind=kind, place_m=place, sigma=sigma, runway_from_board=np.eye(3)))
    return tuple(marks)


# the grid of docs/calibration.md: twelve marks at these tilts, each near the picture's four corners, 40 rows each
GRID_TILTS_DEG, GRID_STANDSTILLS, GRID_ROWS = (-10.0, 20.0, 50.0, 75.0), 48, 40


def head_on_the_grid(rng: np.random.Generator, rows_each: int, noise_deg: float = NOISE_DEG) -> "Head":
    """Return a head, its marks and its sightings at 48 standstills; ``noise_deg`` of its encoders, as in its rig."""
    station = plain_station(ptu_sigma_rad=np.radians(noise_deg))
    true = spoiled(station, rng)
    marks = marks_around(true, rng, tilts_deg=GRID_TILTS_DEG)
    noise = Noise(reading_deg=noise_deg)
    seen = look(true, marks, rng, GRID_STANDSTILLS, noise, in_corners=True, rows_each=rows_each)
    return Head(station=station, true=true, marks=marks, seen=seen)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Head:
    """A station as its rig has it and as it truly is, marks, and what it saw of them."""

    station: Station
    true: Station
    marks: tuple[Mark, ...]
    seen: MountSightings


@dataclass(frozen=True, slots=True, kw_only=True)
class Noise:
    """How a made-up head is read."""

    px: float = NOISE_PX
    reading_deg: float = NOISE_DEG
    step_deg: float = STEP_DEG


def look(
    true: Station,
    marks: tuple[Mark, ...],
    rng: np.random.Generator,
    pointings: int,
    noise: Noise = Noise(),
    bodies: dict[str, np.ndarray] | None = None,
    in_corners: bool = False,
    rows_each: int = 1,
) -> MountSightings:
    """Return the sightings with the head near each mark in turn, approached from either side.

    The mark is anywhere in the picture, or near its corners in turn. ``rows_each``: number of readings of each
    while the head stands still, every row with its own time.
    """
    rows, geometry = [], true.geometry()
    truth = [
        m if m.kind is not MarkKind.POINT else replace(m, place_m=m.place_m + m.sigma * rng.normal(size=3))
        for m in marks
    ]
    pointing = 0
    while pointing < pointings:
        number = pointing % len(truth)
        mark = truth[number]
        far = mark.kind in (MarkKind.DIRECTION, MarkKind.UNKNOWN_DIRECTION)
        centre = true.ptu_position_m + 1e8 * mark.place_m if far else mark.place_m
        aim = aim_at(geometry, centre)
        assert aim is not None
        away = rng.uniform(-1, 1, 2)
        if in_corners:
            round_ = pointing // len(truth)
            away = np.array([(-1) ** round_, (-1) ** (round_ // 2)]) * rng.uniform(0.85, 1.0, 2) * _CORNER
            away[0] /= max(np.cos(aim.tilt_rad), 0.2)
        angles = np.array([aim.pan_rad, aim.tilt_rad]) + np.radians(away * (4.0, 3.0))
        sense = rng.choice([-1.0, 1.0], 2)
        body = (bodies or {}).get(mark.name, np.zeros((1, 3)))
        points = centre + (body @ mark.runway_from_board.T if mark.kind is MarkKind.BOARD else 0.0 * body)
        pixels = [geometry.project(p, *angles) for p in points]
        inside = [p is not None and geometry.contains(p.pixel) for p in pixels]
        if not all(inside):
            continue
        for row in range(rows_each):
            reading = np.degrees(true.ptu_axes.readings(*angles, *sense)) + noise.reading_deg * rng.normal(size=2)
            if noise.step_deg:
                reading = noise.step_deg * np.round(reading / noise.step_deg)
            for point, projection in zip(body, pixels, strict=True):
                assert projection is not None
                pixel = projection.pixel + noise.px * rng.normal(size=2)
                rows.append((np.radians(reading), sense, pixel, pointing * rows_each + row, number, point))
        pointing += 1
    return MountSightings(
        reading_rad=np.array([r[0] for r in rows]),
        sense=np.array([r[1] for r in rows]),
        pixel_px=np.array([r[2] for r in rows]),
        sigma_px=np.full(len(rows), max(noise.px, 1e-3)),
        pointing=np.array([r[3] for r in rows], dtype=np.int64),
        mark=np.array([r[4] for r in rows], dtype=np.int64),
        body_m=np.array([r[5] for r in rows]),
        label=tuple(f"sighting {k}" for k in range(len(rows))),
    )


def off_by(found: Station, true: Station) -> dict[str, float]:
    """Return true minus found of everything that a mount has, rotations as small angles in the frame of their name."""
    from groundstation.geometry.rotation import matrix_from_wxyz

    off = {}
    for group in ("runway_from_base", "head_from_camera"):
        turn = matrix_from_wxyz(getattr(true, f"{group}_wxyz")) @ matrix_from_wxyz(getattr(found, f"{group}_wxyz")).T
        vector = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
        off.update({f"{group}.{axis}": float(v) for axis, v in zip("xyz", vector, strict=True)})
    for axis, value in zip("xyz", true.camera_in_head_m - found.camera_in_head_m, strict=True):
        off[f"camera_in_head.{axis}"] = float(value)
    for name in ("pan_scale", "tilt_scale"):
        off[name] = getattr(true.ptu_axes, name) - getattr(found.ptu_axes, name)
    for name in ("lean", "pan_backlash", "tilt_backlash"):
        off[name] = getattr(true.ptu_axes, f"{name}_rad") - getattr(found.ptu_axes, f"{name}_rad")
    return off
