"""The file of `--camera`: a lens, how it sits in the aircraft, roughly what runway it will see, where it starts."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from groundstation.errors import InputError
from groundstation.files.image_header import MAX_PICTURE_PX
from groundstation.files.toml_table import TomlTable, load_toml
from groundstation.geometry.camera import Lens
from groundstation.onboard.edges.pose import Attitude, NoseCameraPose, RunwayPlace, nose_pose
from groundstation.onboard.edges.search_band import RunwayGuess, position_by_height

_KEYS = frozenset(
    {
        "image_size_px",
        "focal_px",
        "principal_point_px",
        "distortion",
        "mount_deg",
        "runway",
        "start",
        "imu",
        "pose_noise",
    },
)
_RUNWAY_KEYS = frozenset({"width_m", "width_sigma_m", "length_m", "heading_deg", "lat_deg", "lon_deg", "alt_m"})
_NOISE_KEYS = frozenset(
    {
        *("attitude_deg", "position_m", "lasting_attitude_deg", "lasting_height_m"),
        *("lasting_yaw_deg", "lasting_across_m"),
    }
)
_START_KEYS = frozenset({"height_m", "distance_m", "lateral_m", "roll_deg", "pitch_deg", "yaw_deg"})
# of the picture's width: a view of 157°, and one of 0.06°
_LEAST_FOCAL, _MOST_FOCAL = 0.1, 1000.0


class CameraFileError(InputError):
    """A camera file is not usable."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseNoise:
    """Noise of the poses in `--imu` as its maker states it, None where nothing is stated; sigmas in rad and m.

    Attributes
    ----------
    attitude_rad, position_m : white, independent in each row.
    lasting_attitude_rad, lasting_height_m : constant, of roll and pitch, and of height.
    lasting_yaw_rad, lasting_across_m : of yaw and of the place across the runway.
    """

    attitude_rad: float | None = None
    position_m: float | None = None
    lasting_attitude_rad: float | None = None
    lasting_height_m: float | None = None
    lasting_yaw_rad: float | None = None
    lasting_across_m: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NoseCamera:
    """Content of a camera file.

    Attributes
    ----------
    lens, mount : the camera, and its orientation in the aircraft.
    guess : the runway's approximate width and length.
    unsaid : the missing ones of both in the file, width_m or length_m; `RunwayGuess`' own are used for them.
    heading_rad : landing direction, clockwise from north; 0 where yaw is measured from the landing direction.
    place : the threshold on Earth, None where the file does not give it.
    start : pose at the first frame, None where the file does not give it.
    noise : of the poses in `--imu`, as far as the file states it.
    width_sigma_m : how well the width is known, None where the file does not say.
    """

    lens: Lens
    mount: Attitude
    guess: RunwayGuess
    unsaid: tuple[str, ...]
    heading_rad: float
    place: RunwayPlace | None
    start: NoseCameraPose | None
    noise: PoseNoise = PoseNoise()
    width_sigma_m: float | None = None


def load_nose_camera(path: Path) -> NoseCamera:
    """Read a camera file; raises `CameraFileError`."""
    table = TomlTable(load_toml(path, CameraFileError), str(path), CameraFileError)
    # [imu] is read by those who use the inertial unit
    table.refuse_unknown(_KEYS)
    roll, pitch, yaw = np.radians(table.vector("mount_deg", 3, (0.0, 0.0, 0.0)))
    mount = Attitude(roll_rad=float(roll), pitch_rad=float(pitch), yaw_rad=float(yaw))
    runway = table.table("runway")
    runway.refuse_unknown(_RUNWAY_KEYS)
    usual = RunwayGuess()
    guess = RunwayGuess(
        width_m=runway.number("width_m", usual.width_m, minimum=1.0, maximum=200.0),
        length_m=runway.number("length_m", usual.length_m, minimum=20.0, maximum=10_000.0),
        width_announced="width_m" in runway,
    )
    heading = math.radians(runway.number("heading_deg", 0.0))
    return NoseCamera(
        lens=_lens(table),
        mount=mount,
        guess=guess,
        unsaid=tuple(key for key in ("width_m", "length_m") if key not in runway),
        heading_rad=heading,
        place=_place(runway, heading),
        start=_start(table, guess, heading, mount) if "start" in table else None,
        noise=_noise(table),
        width_sigma_m=(
            runway.number("width_sigma_m", minimum=0.0, maximum=guess.width_m) if "width_sigma_m" in runway else None
        ),
    )


def is_camera_file(path: Path) -> bool:
    """Return whether a file is TOML with more than a lens; raises `CameraFileError` where it is damaged TOML."""
    if path.suffix.lower() != ".toml" or not path.is_file():
        return False
    return not {"mount_deg", "runway", "start", "imu"}.isdisjoint(load_toml(path, CameraFileError))


def _lens(table: TomlTable) -> Lens:
    size = table.vector("image_size_px", 2, names="[width, height]")
    if np.any(size < 16) or np.any(size != np.round(size)) or np.any(size > 65536) or np.prod(size) > MAX_PICTURE_PX:
        wanted = f"two whole numbers of pixels from 16 to 65536, at most {MAX_PICTURE_PX // 10**6} million pixels"
        raise table.fail("image_size_px", str(size.tolist()), wanted)
    focal = table.vector("focal_px", 2, names="[fx, fy]")
    least, most = _LEAST_FOCAL * size[0], _MOST_FOCAL * size[0]
    if np.any(focal < least) or np.any(focal > most):
        raise table.fail("focal_px", str(focal.tolist()), f"two numbers of px from {least:g} to {most:g}")
    return Lens(
        image_size_px=(int(size[0]), int(size[1])),
        focal_px=focal,
        principal_point_px=table.vector("principal_point_px", 2, names="[cx, cy]"),
        distortion=table.vector("distortion", 5, (0.0,) * 5),
    )


def _place(runway: TomlTable, heading_rad: float) -> RunwayPlace | None:
    given = [key for key in ("lat_deg", "lon_deg", "alt_m") if key in runway]
    if not given:
        return None
    return RunwayPlace(
        lat_deg=runway.number("lat_deg", minimum=-90.0, maximum=90.0),
        lon_deg=runway.number("lon_deg", minimum=-180.0, maximum=360.0),
        alt_m=runway.number("alt_m"),
        heading_rad=heading_rad,
    )


def _noise(table: TomlTable) -> PoseNoise:
    noise = table.table("pose_noise")
    noise.refuse_unknown(_NOISE_KEYS)

    def stated(key: str, least: float, most: float) -> float | None:
        return noise.number(key, minimum=least, maximum=most) if key in noise else None

    def angle_rad(key: str, least_deg: float) -> float | None:
        angle_deg = stated(key, least_deg, 30.0)
        return None if angle_deg is None else math.radians(angle_deg)

    return PoseNoise(
        attitude_rad=angle_rad("attitude_deg", 0.0),
        position_m=stated("position_m", 0.0, 100.0),
        lasting_attitude_rad=angle_rad("lasting_attitude_deg", 0.001),
        lasting_height_m=stated("lasting_height_m", 0.001, 100.0),
        lasting_yaw_rad=angle_rad("lasting_yaw_deg", 0.001),
        lasting_across_m=stated("lasting_across_m", 0.001, 100.0),
    )


def _start(table: TomlTable, guess: RunwayGuess, heading_rad: float, mount: Attitude) -> NoseCameraPose:
    start = table.table("start")
    start.refuse_unknown(_START_KEYS)
    position = position_by_height(start.number("height_m", above=0.0), guess)
    if "distance_m" in start:
        position[1] = start.number("distance_m")
    position[0] = start.number("lateral_m", 0.0)
    yaw_rad = math.radians(start.number("yaw_deg", math.degrees(heading_rad))) - heading_rad
    attitude = Attitude(
        roll_rad=math.radians(start.number("roll_deg", 0.0)),
        pitch_rad=math.radians(start.number("pitch_deg", 0.0)),
        yaw_rad=yaw_rad,
    )
    return nose_pose(position, attitude, mount)
