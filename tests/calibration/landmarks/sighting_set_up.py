"""A station for `calibrate sightings`: simulated units on ptys, videos of a marked scene as cameras, its landmarks."""

import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.geometry.aim import aim_at
from groundstation.rig.rig import Rig, Station
from groundstation.rig.rig_toml import rig_to_toml
from ptu_drivers.simulated.flir_line import LineModel, SimulatedUnit
from ptu_drivers.simulated.line import VirtualLine
from ptu_drivers.simulated.server import SimulatedServer
from tests.live.test_heads import BAUD, MODEL
from tests.simulation.small_site import small_rig

SIZE = (160, 120)
PLACES_M = {
    "mast": (-20.0, 120.0, 6.0),
    "shed": (25.0, 90.0, 3.0),
    "hut": (-4.0, 60.0, 9.0),
}
FRAMES = 8
RATE_HZ = 50.0


def brisk_unit(link: Path) -> SimulatedServer:
    """Return a simulated unit at a link that is soon where it turns to; a context manager."""
    unit = SimulatedUnit(MODEL.replace(acceleration=200_000), LineModel(baud=BAUD, latency_s=(0.0, 0.001)))
    return SimulatedServer(VirtualLine(unit, BAUD, start_s=time.monotonic()), link)


def true_rig() -> Rig:
    """Return the rig as it stands, with encoders of the simulated unit."""
    rig = small_rig(focal_px=1600.0, size_px=SIZE)
    step = {"ptu_resolution_rad": float(np.radians(22.5 / 3600.0)), "ptu_sigma_rad": float(np.radians(0.002))}
    return replace(rig, stations=tuple(replace(s, **step) for s in rig.stations))


def scene(shift_px: FloatArray, mark_px: FloatArray) -> ImageArray:
    """Return a textured picture with a cross at ``mark_px`` (2,), all of it moved by ``shift_px`` (2,)."""
    generator = np.random.default_rng(7)
    grey = cv2.GaussianBlur(generator.normal(120.0, 90.0, (SIZE[1], SIZE[0])), (0, 0), 2.0)
    u, v = (round(float(c)) for c in mark_px)
    grey[v - 6 : v + 7, u - 1 : u + 2] = 235.0
    grey[v - 1 : v + 2, u - 6 : u + 7] = 235.0
    moved = cv2.warpAffine(
        cv2.GaussianBlur(grey, (0, 0), 0.8),
        np.array([[1.0, 0.0, shift_px[0]], [0.0, 1.0, shift_px[1]]]),
        SIZE,
        flags=cv2.INTER_CUBIC,
        borderMode=cv2.BORDER_REFLECT,
    )
    return np.repeat(np.clip(moved, 0, 255).astype(np.uint8)[:, :, None], 3, axis=2)


def shifts() -> FloatArray:
    """Return by how much the scene of each frame (n, 2) is moved, px; the first is not."""
    found = np.random.default_rng(3).normal(0.0, 0.4, (FRAMES, 2))
    found[0] = 0.0
    return found


def mark_px(station: Station) -> FloatArray:
    """Return the whole pixel (2,) next to the principal point: the mark's in the videos' first frames."""
    return np.round(station.lens.principal_point_px)


def write_camera(path: Path, station: Station) -> None:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"FFV1"), RATE_HZ, SIZE)
    assert writer.isOpened()
    for shift in shifts():
        writer.write(scene(shift, mark_px(station)))
    writer.release()


def write_landmarks(path: Path) -> Path:
    rows = [f"{name},{x},{y},{z}" for name, (x, y, z) in PLACES_M.items()]
    path.write_text("landmark,x_m,y_m,z_m\n" + "\n".join(rows) + "\n", encoding="utf-8")
    return path


def write_station(folder: Path, rig: Rig) -> Path:
    """Write rig, videos and the station file; the units' links are left and right in the same folder."""
    (folder / "rig.toml").write_text(rig_to_toml(rig), encoding="utf-8")
    text = 'format = "groundstation-station/1"\nrig = "rig.toml"\nrate_hz = 50\n[safety]\nsun_angle_deg = 0\n'
    for station in rig.stations:
        write_camera(folder / f"{station.name}.avi", station)
        text += f'[[station]]\nname = "{station.name}"\ncamera = "file:{folder}/{station.name}.avi"\n'
        text += f'ptu = "{folder}/{station.name}"\nptu_settings = {{ baud = 115200 }}\n'
    (folder / "field.toml").write_text(text, encoding="utf-8")
    return folder / "field.toml"


def aims(station: Station) -> dict[str, tuple[float, float]]:
    """Return the angles, deg, at which each landmark is on the principal point."""
    found = {}
    for name, place in PLACES_M.items():
        aim = aim_at(station.geometry(), np.array(place))
        assert aim is not None
        found[name] = (float(np.degrees(aim.pan_rad)), float(np.degrees(aim.tilt_rad)))
    return found
