"""A rendered approach as files: nose.avi without loss, nose.toml, imu.csv, truth.csv."""

import csv
import io
import math
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from groundstation.arrays import FloatArray
from groundstation.errors import InputError, os_words
from groundstation.files.new_folder import make_folder, removed_if_empty
from groundstation.files.overwriting import refuse_existing
from groundstation.files.video_check import require_whole_video
from groundstation.files.whole_file import whole_file
from groundstation.geometry.rotation import wxyz_from_matrix
from groundstation.onboard.scenes.draw_nose_world import NoseWorld, draw_nose_world, reported_poses
from groundstation.onboard.scenes.nose_flight import (
    CAMERA_PITCH_DEG,
    NoseFlight,
    attitude_of,
    navigation_poses,
    nose_flight,
    nose_setup,
)
from groundstation.onboard.scenes.sequences import SEQUENCES
from groundstation.onboard.visual_inertial.inertial_unit_file import SAMPLE_COLUMNS

_FFV1 = sum(ord(c) << 8 * i for i, c in enumerate("FFV1"))
POSE_COLUMNS = ("roll_deg", "pitch_deg", "yaw_deg", "x_m", "y_m", "z_m")
TRUTH_COLUMNS = ("t_s", "x_m", "y_m", "z_m", "vx_m_s", "vy_m_s", "vz_m_s", "roll_deg", "pitch_deg", "yaw_deg")


def drawn_flight(scene: int, seed: int, frames: int = 130, motion: str = "waves") -> NoseFlight:
    """Return the flight of a scene, `SEQUENCES`' number, and a seed; ``motion`` is waves or jsbsim."""
    sequence = SEQUENCES[scene]
    sequence = replace(sequence, seed=sequence.seed + 10_000 * seed)
    setup = nose_setup(sequence)
    setup = replace(setup, duration_s=frames / setup.camera_hz)
    if motion == "jsbsim":
        from groundstation.onboard.scenes.jsbsim_flight import jsbsim_nose_flight

        return jsbsim_nose_flight(sequence, setup)
    return nose_flight(sequence, setup)


def render_flight(
    folder: Path,
    scene: int,
    seed: int,
    frames: int,
    motion: str = "waves",
    progress: Callable[[int, int | None], None] = lambda done, total: None,
) -> tuple[Path, ...]:
    """Write a flight's files; returns them.

    Raises `InputError` where the folder cannot be written, or one of the files already exists.
    """
    flight = drawn_flight(scene, seed, frames, motion)
    attitude, place = navigation_poses(flight, np.random.default_rng([flight.sequence.seed, 5]))
    account = NavigationAccount(attitude_rad=attitude, place_m=place)
    return _write_flight(folder, flight, camera_file(flight, attitude, place), account, progress)


def render_world(
    folder: Path,
    seed: int,
    frames: int,
    progress: Callable[[int, int | None], None] = lambda done, total: None,
) -> tuple[Path, ...]:
    """Write the files of a drawn approach, as `render_flight` does; without poses where its unit gives none.

    Raises `InputError` as that, and `ScenarioError` for a seed of no set.
    """
    world = draw_nose_world(seed, frames)
    attitude, place = reported_poses(world)
    account = NavigationAccount(attitude_rad=attitude, place_m=place, poses=world.poses)
    return _write_flight(folder, world.flight, world_camera_file(world, account), account, progress)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NavigationAccount:
    """A navigation's attitude (n, 3) in rad and place (n, 3) in m at each sample; ``poses``: whether a log has them."""

    attitude_rad: FloatArray
    place_m: FloatArray
    poses: bool = True


def _write_flight(
    folder: Path,
    flight: NoseFlight,
    camera_text: str,
    account: NavigationAccount,
    progress: Callable[[int, int | None], None],
) -> tuple[Path, ...]:
    files = tuple(folder / name for name in ("nose.avi", "nose.toml", "imu.csv", "truth.csv"))
    refuse_existing(files)
    try:
        with removed_if_empty(folder):
            make_folder(folder)
            whole = False
            try:
                with ExitStack() as drafts:
                    # names are given in the reverse order, the video's last: a run that is killed leaves none
                    video, *tables = (drafts.enter_context(whole_file(path)) for path in files)
                    video.open("wb").close()
                    for path, content in zip(tables, _texts(flight, camera_text, account), strict=True):
                        path.write_text(content, encoding="utf-8")
                    _film(video, flight, progress)
                whole = True
            finally:
                for path in () if whole else files:
                    path.unlink(missing_ok=True)
    except OSError as fault:
        raise InputError(str(folder), got=os_words(fault), wanted="a folder that can be written") from fault
    return files


def _texts(flight: NoseFlight, camera_text: str, account: NavigationAccount) -> tuple[str, str, str]:
    """Return the contents of nose.toml, imu.csv and truth.csv."""
    columns = (*SAMPLE_COLUMNS, *POSE_COLUMNS) if account.poses else SAMPLE_COLUMNS
    return camera_text, _table(columns, _log_rows(flight, account)), _table(TRUTH_COLUMNS, _truth_rows(flight))


def _film(path: Path, flight: NoseFlight, progress: Callable[[int, int | None], None]) -> None:
    """Write the video; raises `OSError` where the disk did not take all of it."""
    video = cv2.VideoWriter(str(path), _FFV1, float(flight.setup.camera_hz), flight.setup.lens.image_size_px)
    if not video.isOpened():
        wanted = "the FFV1 codec, and room on the disk"
        raise InputError("nose.avi", got="a video that OpenCV cannot write", wanted=wanted)
    try:
        for number, (_, image) in enumerate(flight.pictures(), start=1):
            video.write(image)
            progress(number, len(flight.frames))
    finally:
        video.release()
    require_whole_video(path, len(flight.frames))


def camera_file(flight: NoseFlight, attitude_rad: FloatArray, place_m: FloatArray) -> str:
    """Return the camera file's text, which starts at the navigation's attitude (n, 3) and place (n, 3) then."""
    lens, field, first = flight.setup.lens, flight.sequence.airfield, flight.frames[0]
    return (
        f"image_size_px = {list(lens.image_size_px)}\n"
        f"focal_px = {lens.focal_px.tolist()}\n"
        f"principal_point_px = {lens.principal_point_px.tolist()}\n"
        f"mount_deg = [0.0, {CAMERA_PITCH_DEG}, 0.0]\n\n"
        f"[runway]\nwidth_m = {field.width_m}\nlength_m = {field.length_m}\n\n"
        f"{_start(attitude_rad[first], place_m[first])}\n"
        f"[imu]\ncamera_in_body_m = {flight.setup.mount.camera_in_body_m.tolist()}\n"
    )


def world_camera_file(world: NoseWorld, account: NavigationAccount) -> str:
    """Return the camera file's text of a drawn approach: what was drawn in a comment, and what a user would know."""
    flight, mount, noise = world.flight, world.mount, world.noise
    lens, first, unit = flight.setup.lens, flight.frames[0], flight.setup.config
    angles = [round(math.degrees(one), 6) for one in (mount.roll_rad, mount.pitch_rad, mount.yaw_rad)]
    stated = ""
    if noise.attitude_rad is not None and noise.lasting_attitude_rad is not None:
        stated = (
            f"[pose_noise]\nattitude_deg = {math.degrees(noise.attitude_rad):.6g}\nposition_m = {noise.position_m}\n"
            f"lasting_attitude_deg = {math.degrees(noise.lasting_attitude_rad):.6g}\n"
            f"lasting_height_m = {noise.lasting_height_m}\n\n"
        )
    return (
        f"# seed {flight.sequence.seed}: {'; '.join(f'{name} {kind}' for name, kind in world.factors.items())}\n"
        f"image_size_px = {list(lens.image_size_px)}\nfocal_px = {lens.focal_px.tolist()}\n"
        f"principal_point_px = {lens.principal_point_px.tolist()}\ndistortion = {lens.distortion.tolist()}\n"
        f"mount_deg = {angles}\n\n"
        f"[runway]\nwidth_m = {world.announced_m:.3f}\nlength_m = {flight.sequence.airfield.length_m:.3f}\n\n"
        f"{_start(account.attitude_rad[first], account.place_m[first])}\n{stated}"
        f"[imu]\ncamera_in_body_m = {flight.setup.mount.camera_in_body_m.tolist()}\n"
        f"force_noise = {unit.force_noise:.6g}\nrate_noise = {unit.rate_noise:.6g}\n"
        f"force_bias_sigma = {unit.force_bias_sigma:.6g}\nrate_bias_sigma = {unit.rate_bias_sigma:.6g}\n"
    )


def _start(attitude_rad: FloatArray, place_m: FloatArray) -> str:
    """Return the section of a start at an attitude (3,) and a place (3,)."""
    x, y, z = place_m
    roll, pitch, yaw = np.degrees(attitude_rad)
    return (
        f"[start]\nheight_m = {z:.3f}\ndistance_m = {y:.3f}\nlateral_m = {x:.3f}\n"
        f"roll_deg = {roll:.3f}\npitch_deg = {pitch:.3f}\nyaw_deg = {yaw:.3f}\n"
    )


def _log_rows(flight: NoseFlight, account: NavigationAccount) -> Iterable[list[float]]:
    angles = np.degrees(account.attitude_rad)
    for sample, turned, at in zip(flight.motion.samples, angles, account.place_m, strict=True):
        pose = [*turned, *at] if account.poses else []
        yield [sample.t_s, *sample.force_m_s2, *np.degrees(sample.rate_rad_s), *pose]


def _truth_rows(flight: NoseFlight) -> Iterable[list[float]]:
    """Yield the camera's exact place at each picture."""
    for k in flight.frames:
        motion = flight.motion
        angles = np.degrees(attitude_of(wxyz_from_matrix(motion.runway_from_body[k])))
        place = flight.pose(k).camera_threshold_m
        yield [float(motion.t_s[k]), *place, *motion.velocity_m_s[k], *angles]


def _table(columns: tuple[str, ...], rows: Iterable[list[float]]) -> str:
    stream = io.StringIO()
    out = csv.writer(stream, lineterminator="\n")
    out.writerow(columns)
    out.writerows([f"{value:.9g}" for value in row] for row in rows)
    return stream.getvalue()
