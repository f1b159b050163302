"""Made-up swings of a PTU: readings and a camera's turns, and rendered pictures of a scene with texture."""

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from calibration.clocks.image_motion import ImageMotion
from groundstation.rig.rig import Rig, Station
from groundstation.rig.rig_toml import rig_to_toml
from tests.calibration.mount.mounts import plain_station


@dataclass(frozen=True, slots=True, kw_only=True)
class Swing:
    """A sine of pan and a smaller, slower one of tilt; amplitudes in deg, rates in Hz."""

    pan_deg: float = 4.0
    tilt_deg: float = 1.5
    pan_hz: float = 0.4
    tilt_hz: float = 0.27

    def at(self, t_s: np.ndarray) -> np.ndarray:
        """Return pan and tilt (n, 2), rad, at true times."""
        pan = self.pan_deg * np.sin(2 * np.pi * self.pan_hz * t_s)
        tilt = self.tilt_deg * np.sin(2 * np.pi * self.tilt_hz * t_s + 0.7)
        return np.radians(np.stack([pan, tilt], axis=-1))

    def rate(self, t_s: np.ndarray) -> np.ndarray:
        """Return the rates (n, 2), rad/s."""
        return (self.at(t_s + 1e-5) - self.at(t_s - 1e-5)) / 2e-5


@dataclass(frozen=True, slots=True, kw_only=True)
class Recorder:
    """How a swing is recorded; the PTU's stamps are ``offset_s`` too early."""

    seconds: float = 15.0
    frame_hz: float = 15.0
    reading_hz: float = 50.0
    offset_s: float = 0.023
    drift: float = 0.0
    reading_deg: float = 0.01
    step_deg: float = 0.0
    turn_deg: float = 0.0005


def recorded(swing: Swing, how: Recorder, rng: np.random.Generator) -> tuple[np.ndarray, ImageMotion]:
    """Return readings (m, 3) and the camera's turns."""
    t = np.arange(0.0, how.seconds, 1.0 / how.frame_hz) + 1.0
    turn = np.diff(swing.at(t), axis=0) + np.radians(how.turn_deg) * rng.normal(size=(len(t) - 1, 2))
    motion = ImageMotion(
        from_s=t[:-1],
        to_s=t[1:],
        turn_rad=turn,
        sigma_rad=np.full(turn.shape, np.radians(how.turn_deg)),
        frames=len(t) - 1,
        plain=0,
        torn=0,
    )
    at = np.arange(0.0, how.seconds + 2.0, 1.0 / how.reading_hz)
    readings = np.degrees(swing.at(at)) + how.reading_deg * rng.normal(size=(len(at), 2))
    if how.step_deg:
        readings = how.step_deg * np.round(readings / how.step_deg)
    middle = 0.5 * (t[0] + t[-1])
    stamps = at - how.offset_s - how.drift * (at - middle)
    return np.column_stack([stamps, np.radians(readings)]), motion


def offset_bound(swing: Swing, how: Recorder) -> float:
    """Return the Cramér-Rao bound of the offset, s: amplitudes, phases and rates of the sines, and the offset, unknown.

    Readings see the sines at the PTU's times, turns their differences at the camera's.
    """
    t = np.arange(0.0, how.seconds, 1.0 / how.frame_hz) + 1.0
    at = np.arange(0.0, how.seconds + 2.0, 1.0 / how.reading_hz)
    information = np.zeros((9, 9))
    axes = ((swing.pan_deg, swing.pan_hz, 0.0), (swing.tilt_deg, swing.tilt_hz, 0.7))
    for axis, (size, hz, phase) in enumerate(axes):

        def columns(times, size=size, hz=hz, phase=phase, axis=axis):
            angle = 2 * np.pi * hz * times + phase
            full = np.zeros((len(times), 9))
            own = slice(1 + 4 * axis, 5 + 4 * axis)
            full[:, own] = np.column_stack(
                [np.sin(angle), size * np.cos(angle), size * np.cos(angle) * 2 * np.pi * times, np.ones(len(times))]
            )
            return full

        seen = columns(at)
        # a PTU that is so much later has its readings at another phase
        seen[:, 0] = np.degrees(swing.rate(at)[:, axis])
        turned = np.diff(columns(t), axis=0)
        scatter = np.hypot(how.reading_deg, how.step_deg / np.sqrt(12.0))
        information += seen.T @ seen / scatter**2 + turned.T @ turned / how.turn_deg**2
    scale = np.sqrt(np.diag(information))
    return float(np.sqrt(np.linalg.inv(information / np.outer(scale, scale))[0, 0]) / scale[0])


class Scene:
    """A far panorama with texture of all sizes, and what a station's camera sees of it."""

    def __init__(self, seed: int = 3, px_per_deg: float = 60.0, span_deg: tuple[float, float] = (30.0, 20.0)) -> None:
        rng = np.random.default_rng(seed)
        self._scale = px_per_deg
        self._span = span_deg
        size = (int(px_per_deg * span_deg[1]), int(px_per_deg * span_deg[0]))
        picture = np.zeros(size)
        for blur, weight in ((2.0, 30.0), (6.0, 60.0), (20.0, 120.0)):
            picture += weight * blur * cv2.GaussianBlur(rng.normal(size=size), (0, 0), blur)
        self._picture = np.clip(120.0 + picture, 0, 255).astype(np.float32)

    def seen(self, station: Station, angles: np.ndarray) -> np.ndarray:
        """Return a picture (h, w, 3) where each row has its own pan and tilt, (h, 2), rad."""
        w, h = station.lens.image_size_px
        u, v = np.meshgrid(np.arange(w, dtype=np.float64), np.arange(h, dtype=np.float64))
        x = (u - station.lens.principal_point_px[0]) / station.lens.focal_px[0]
        z = -(v - station.lens.principal_point_px[1]) / station.lens.focal_px[1]
        # the optical axis of an ideal camera is the head's y: tilt, then pan
        pan, tilt = angles[:, :1], angles[:, 1:]
        y1, z1 = np.cos(tilt) - np.sin(tilt) * z, np.sin(tilt) + np.cos(tilt) * z
        right, forward = np.cos(pan) * x - np.sin(pan) * y1, np.sin(pan) * x + np.cos(pan) * y1
        azimuth, height = np.degrees(np.arctan2(right, forward)), np.degrees(np.arctan2(z1, np.hypot(right, forward)))
        columns = (self._scale * (azimuth + 0.5 * self._span[0])).astype(np.float32)
        rows = (self._scale * (0.5 * self._span[1] - height)).astype(np.float32)
        grey = cv2.remap(self._picture, columns, rows, cv2.INTER_CUBIC)
        return np.repeat(np.clip(np.round(grey), 0, 255).astype(np.uint8)[:, :, None], 3, axis=2)


@lru_cache
def panorama() -> Scene:
    """The scene of every session, drawn once."""
    return Scene()


def small_station(name: str = "left", **changes: object) -> Station:
    """Return a station with a small picture and no distortion."""
    plain = plain_station()
    lens = replace(
        plain.lens,
        image_size_px=(400, 300),
        focal_px=np.array([2300.0, 2300.0]),
        principal_point_px=np.array([199.5, 149.5]),
        distortion=np.zeros(5),
    )
    return replace(plain, name=name, lens=lens, camera_in_head_m=np.zeros(3), **changes)


def write_session(folder: Path, stations: list[Station], swing: Swing, how: Recorder, rng: np.random.Generator) -> Path:
    """Write a session of rendered pictures; station k's camera stamps are late by k · 10 ms."""
    folder.mkdir(parents=True, exist_ok=True)
    scene = panorama()
    t = np.arange(0.0, how.seconds, 1.0 / how.frame_hz) + 1.0
    rows = ["index," + ",".join(f"{s.name}_t_s" for s in stations)]
    for index, at in enumerate(t):
        rows.append(f"{index}," + ",".join(f"{at + 0.01 * k:.6f}" for k in range(len(stations))))
    (folder / "frames.csv").write_text("\n".join(rows) + "\n")
    for station in stations:
        (folder / station.name).mkdir(exist_ok=True)
        height = station.lens.image_size_px[1]
        share = (np.arange(height) + 0.5) / height - 0.5
        for index, at in enumerate(t):
            picture = scene.seen(station, swing.at(at + share * station.readout_s))
            noisy = picture + rng.normal(size=picture.shape[:2])[:, :, None]
            cv2.imwrite(str(folder / station.name / f"{index:06d}.png"), np.clip(noisy, 0, 255).astype(np.uint8))
    at = np.arange(0.0, how.seconds + 2.0, 1.0 / how.reading_hz)
    columns = [at - how.offset_s]
    for _ in stations:
        angles = np.degrees(swing.at(at)) + how.reading_deg * rng.normal(size=(len(at), 2))
        columns += list(angles.T)
    names = ["t_s", *(f"{s.name}_{axis}_deg" for s in stations for axis in ("pan", "tilt"))]
    text = [",".join(names), *(",".join(f"{v:.6f}" for v in row) for row in zip(*columns, strict=True))]
    (folder / "ptu.csv").write_text("\n".join(text) + "\n")
    (folder / "session.toml").write_text('name = "swing"\n')
    (folder / "rig.toml").write_text(rig_to_toml(Rig(stations=tuple(stations))))
    return folder
