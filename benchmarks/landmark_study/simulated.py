"""A rig drawn around the assumed one, and its sightings of landmarks with noisy, quantised encoders."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibration.sightings import Landmark, LandmarkSighting
from groundstation.geometry.aim import aim_at
from groundstation.geometry.calibration import CALIBRATION_PARAMETERS
from groundstation.geometry.camera import Lens
from groundstation.geometry.rotation import matrix_from_wxyz
from groundstation.rig.rig import ClockModel, Rig, Station

SIGMA_DEG, STEP_DEG, SIGMA_PX, SIGMA_M = 0.01, 0.00625, 0.3, 0.02
PLACES_M = ((-60, 120, 3), (50, 180, 6), (-20, 320, 2), (30, 90, 1), (90, 60, 8), (-80, 40, 5))
# priors of a morning: mount to 0.003 deg, lens to 3 px and 1 px
MOUNT_RAD, FOCAL_PX, CENTRE_PX = float(np.radians(0.003)), 3.0, 1.0
TOTAL_STATION_M = 0.005
Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SurveyScene:
    """The ``true`` rig, the assumed one (``stated``), the true landmarks and those of the table."""

    true: Rig
    stated: Rig
    stands: Mapping[str, Landmark]
    table: Mapping[str, Landmark]


def station(name: str, x_m: float) -> Station:
    """Return an ideal station of a 50 mm lens on a runway's side."""
    return Station(
        name=name,
        fixed=False,
        known=("position", "orientation", "lens"),
        ptu_position_m=np.array([x_m, 0.0, 1.6]),
        runway_from_base_wxyz=np.array([1.0, 0.0, 0.0, 0.0]),
        head_from_camera_wxyz=np.array([0.5**0.5, -(0.5**0.5), 0.0, 0.0]),
        camera_in_head_m=np.array([0.01, 0.065, 0.046]),
        lens=Lens(
            image_size_px=(1280, 960),
            focal_px=np.array([6684.0, 6680.0]),
            principal_point_px=np.array([646.0, 471.0]),
            distortion=np.array([-0.2, 0.5, 0.0, 0.0, 0.0]),
        ),
        ptu_resolution_rad=float(np.radians(STEP_DEG)),
        ptu_sigma_rad=float(np.radians(SIGMA_DEG)),
        ptu_clock=ClockModel(),
        camera_clock=None,
        readout_s=0.0,
        covariance_parameters=(),
        covariance=np.zeros((0, 0)),
    )


def morning(
    generator: np.random.Generator,
    *,
    total_station: bool = True,
    uncertain: bool = True,
    places_m: Sequence[Sequence[float]] = PLACES_M,
    tipped_rad: float = 0.03,
) -> SurveyScene:
    """Draw a morning: bases turned by ``tipped_rad`` about each axis and by any pan, of which the rig states nothing.

    With a ``total_station`` positions are known to 5 mm, else not at all; ``uncertain`` mounts and lenses are off by
    their sigmas in the rig.
    """
    sigma = {"ptu_position": TOTAL_STATION_M} if total_station else {}
    if uncertain:
        sigma |= {"head_from_camera": MOUNT_RAD, "focal": FOCAL_PX, "principal_point": CENTRE_PX}
    names = tuple(n for n in CALIBRATION_PARAMETERS if n.partition(".")[0] in sigma)
    sigmas = np.array([sigma[n.partition(".")[0]] for n in names])
    true, stated = [], []
    for name, x in (("left", -5.385), ("right", 5.385)):
        ideal = station(name, x)
        off = np.zeros(len(CALIBRATION_PARAMETERS))
        off[[CALIBRATION_PARAMETERS.index(n) for n in names]] = generator.normal(0.0, sigmas)
        off[0:3] = generator.normal(0.0, tipped_rad, 3)
        turned = ideal.changed(off)
        pan = np.zeros(len(off))
        pan[2] = generator.uniform(-np.pi, np.pi)
        true.append(turned.changed(pan))
        known = ("position", "lens") if total_station else ("lens",)
        unknown = ideal if total_station else replace(ideal, ptu_position_m=np.zeros(3))
        stated.append(replace(unknown, known=known, covariance_parameters=names, covariance=np.diag(sigmas**2)))
    table = {
        f"m{k}": Landmark(name=f"m{k}", kind="point", place=np.array(p, dtype=np.float64), sigma=np.full(3, SIGMA_M))
        for k, p in enumerate(places_m)
    }
    stands = {n: replace(m, place=m.place + generator.normal(0.0, SIGMA_M, 3)) for n, m in table.items()}
    return SurveyScene(true=Rig(stations=tuple(true)), stated=Rig(stations=tuple(stated)), stands=stands, table=table)


def look(
    rig: Rig, landmarks: Mapping[str, Landmark], generator: np.random.Generator, readings: int
) -> list[LandmarkSighting]:
    """Aim every station at every landmark, a little off, and read angles and pixel so many times."""
    found: list[LandmarkSighting] = []
    for own in rig.stations:
        geometry = own.geometry()
        step, sigma = own.ptu_resolution_rad, own.ptu_sigma_rad
        for mark in landmarks.values():
            if mark.place is None:
                raise ValueError(f"landmark {mark.name} has no place")
            point = mark.place if mark.kind == "point" else own.ptu_position_m + 1e8 * mark.place
            aim = aim_at(geometry, point)
            if aim is None:
                raise ValueError(f"no angles at which {own.name} sees {mark.name}")
            angles = np.array([aim.pan_rad, aim.tilt_rad]) + generator.uniform(-2e-3, 2e-3, 2)
            seen = geometry.project(point, float(angles[0]), float(angles[1]))
            if seen is None:
                raise ValueError(f"{mark.name} is behind {own.name}")
            for _ in range(readings):
                read = angles + generator.normal(0.0, sigma, 2)
                read = step * np.round(read / step) if step else read
                found.append(
                    LandmarkSighting(
                        station=own.name,
                        landmark=mark.name,
                        pan_rad=float(read[0]),
                        tilt_rad=float(read[1]),
                        pixel_px=seen.pixel + generator.normal(0.0, SIGMA_PX, 2),
                        sigma_px=SIGMA_PX,
                        t_s=None,
                        pan_from=1,
                        tilt_from=1,
                        line=len(found) + 2,
                    )
                )
    return found


def knocked(rig: Rig, name: str, axis: int, angle_rad: float) -> Rig:
    """Return the rig with one base turned about its own axis 0 (tilt), 1 (roll) or 2 (pan)."""
    turn = np.zeros(len(CALIBRATION_PARAMETERS))
    turn[0:3] = matrix_from_wxyz(rig[name].runway_from_base_wxyz)[:, axis] * angle_rad
    return replace(rig, stations=tuple(s.changed(turn) if s.name == name else s for s in rig.stations))


def turned_rad(found: Station, true: Station) -> Array:
    """Return by which small rotation (3,), runway frame, the true base differs from the one found."""
    off = matrix_from_wxyz(true.runway_from_base_wxyz) @ matrix_from_wxyz(found.runway_from_base_wxyz).T
    return 0.5 * np.array([off[2, 1] - off[1, 2], off[0, 2] - off[2, 0], off[1, 0] - off[0, 1]])


def write_sightings(path: Path, sightings: Sequence[LandmarkSighting]) -> None:
    """Write sightings.csv, with stamps at 10 Hz."""
    rows = [
        f"{s.station},{s.landmark},{np.degrees(s.pan_rad):.6f},{np.degrees(s.tilt_rad):.6f},"
        f"{s.pixel_px[0]:.4f},{s.pixel_px[1]:.4f},{0.1 * k:.1f}"
        for k, s in enumerate(sightings)
    ]
    path.write_text("\n".join(["station,landmark,pan_deg,tilt_deg,u_px,v_px,t_s", *rows]) + "\n")


def write_landmarks(path: Path, landmarks: Mapping[str, Landmark]) -> None:
    """Write landmarks.csv."""
    rows = [
        ",".join([m.name, *(repr(float(v)) for v in (*(() if m.place is None else m.place), *m.sigma)), m.kind])
        for m in landmarks.values()
    ]
    path.write_text("\n".join(["landmark,x_m,y_m,z_m,sigma_x_m,sigma_y_m,sigma_z_m,kind", *rows]) + "\n")
