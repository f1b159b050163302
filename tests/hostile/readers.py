"""Every reader of a file that others may have made, with small whole files for it to begin from."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from calibration.lens.lens_files import read_lens
from calibration.pictures import read_pictures
from calibration.sightings import read_landmarks, read_sightings
from groundstation.bank.bank_settings import load_bank_settings
from groundstation.bank.run_log import COLUMNS, require_log
from groundstation.errors import SessionError
from groundstation.live.station_file import load_station
from groundstation.onboard.edges.camera_file import load_nose_camera
from groundstation.onboard.edges.imu_file import load_imu
from groundstation.onboard.pose.pose_files import Runways, read_corners
from groundstation.onboard.visual_inertial.ground_track import read_ground_track
from groundstation.onboard.visual_inertial.inertial_unit_file import load_unit, read_samples
from groundstation.planning.site_file import load_site
from groundstation.session.flight_log import load_flight_log
from groundstation.session.logs.fixes import LogOptions
from groundstation.session.logs.read import read_log
from groundstation.session.media import read_image
from groundstation.simulation.render_flight import load_faults
from groundstation.simulation.world.draw_world import draw_world
from groundstation.simulation.world.world_file import load_world, world_text
from groundstation.sinks.mp4_tables import mp4_fault
from groundstation.viewer.recording_check import check_recording, read_to_end
from groundstation.viewer.results_recording import write_results_recording
from tests.calibration.lens.test_lens_files import KALIBR, ROS
from tests.session.damage import VIDEOS, session_targets
from tests.session.logs.damage import seeds

ROOT = Path(__file__).resolve().parents[2]
OPTIONS = LogOptions(geoid_separation_m=37.7, base_deg_m=(35.68, 139.76, 60.0))
BANK = (
    'format = "groundstation-bank/1"\nworld_set = "validate"\nsessions = 20\nfirst = 3\nduration_s = 20.0\nworst = 5\n'
)
NOSE = """image_size_px = [640, 480]
focal_px = [900.0, 900.0]
principal_point_px = [320.0, 240.0]
mount_deg = [0.0, -3.0, 0.0]
[runway]
width_m = 30.0
length_m = 900.0
lat_deg = 47.0
lon_deg = 8.0
alt_m = 400.0
[start]
height_m = 40.0
distance_m = 800.0
lateral_m = 1.0
roll_deg = 0.0
pitch_deg = 0.0
yaw_deg = 0.0
[imu]
camera_in_body_m = [1.0, 0.0, 0.0]
"""
IMU = (
    "t_s,roll_deg,pitch_deg,yaw_deg,x_m,y_m,z_m,force_x_m_s2,force_y_m_s2,force_z_m_s2,"
    "rate_x_deg_s,rate_y_deg_s,rate_z_deg_s\n"
    "0.0,0,0,0,0,800,40,0.1,0,-9.8,0,0,0\n0.1,0,0,0,0,797,39.8,0.1,0,-9.8,0,0,0\n"
)
SIGHTINGS = "station,landmark,pan_deg,tilt_deg,u_px,v_px\nleft,mast,1.0,2.0,30.5,20.25\nleft,church,2.0,2.0,31,21\n"
LANDMARKS = "landmark,x_m,y_m,z_m\nmast,1,300,10\nchurch,-20,400,30\n"
CORNERS = "filename,x_A,y_A,x_B,y_B,x_C,y_C,x_D,y_D\nLFRS_03_1.jpeg,1,2,3,4,5,6,7,8\nLFRS_03_2.jpeg,,,,,,,,\n"
RUNWAYS = '{"LFRS": {"03": {"A": {"latitude": 47.1, "longitude": -1.6, "altitude": 27}}}}'
FLIGHT = "timestamp,Lat,Lng,Alt\n0.0,47.0,8.0,450.0\n0.2,47.00001,8.0,450.1\n"
FAULTS = '[[fault]]\nwhat = "camera_lost"\nstation = "left"\nfrom_s = 1.0\nto_s = 2.0\n'
TRACK = (
    "t_s,x_m,y_m,z_m,vx_m_s,vy_m_s,vz_m_s,cov_xx_m2,cov_xy_m2,cov_xz_m2,cov_yy_m2,cov_yz_m2,cov_zz_m2,status\n"
    "1.0,0,300,20,0,-15,-1,0.1,0,0,0.2,0,0.1,tracking\n1.1,0,298,20,0,-15,-1,0.1,0,0,0.2,0,0.1,tracking\n1.2"
    + "," * 12
    + ",lost\n"
)
TUM = "1.0 0 300 20 0 0 0 1\n1.1 0 298 20 0 0 0 1\n"


@dataclass(frozen=True, slots=True, kw_only=True)
class Reader:
    """What reads the file ``path``; ``seeds`` are whole ones, ``slow`` if one takes more than a few milliseconds.

    ``in_child`` is what ``read`` runs in a process of its own, where some library aborts the process on a damaged file.
    """

    path: Path
    read: Callable[[], object]
    seeds: tuple[bytes, ...]
    slow: bool = False
    in_child: Callable[[], object] | None = None


def readers(folder: Path) -> dict[str, Reader]:
    """Write a small session and other files into an empty folder; return by name what reads each of them."""
    found: dict[str, Reader] = {}
    session = folder / "session"
    session.mkdir()
    for name, read in session_targets(session).items():
        path = session / name
        slow = name in ("flight.mcap", "left/000001.png", *VIDEOS)
        found[name] = Reader(path=path, read=read, seeds=(path.read_bytes(),), slow=slow)
    found |= _logs(folder)
    found |= _pictures(folder)
    found |= _others(folder)
    return found


def _logs(folder: Path) -> dict[str, Reader]:
    by_suffix: dict[str, list[bytes]] = {}
    for name, content in seeds().items():
        by_suffix.setdefault(Path(name).suffix, []).append(content)
    return {f"log{suffix}": _reader(folder / f"log{suffix}", _log, *contents) for suffix, contents in by_suffix.items()}


def _log(path: Path) -> object:
    return read_log(path, OPTIONS)


def _pictures(folder: Path) -> dict[str, Reader]:
    rng = np.random.default_rng(1)
    image = rng.integers(0, 256, (24, 32, 3), dtype=np.uint8)
    found = {}
    for suffix in (".png", ".jpg", ".bmp", ".tif"):
        content = cv2.imencode(suffix, image)[1].tobytes()
        found[f"picture{suffix}"] = _reader(folder / f"picture{suffix}", _picture, content)
        found[f"board{suffix}"] = _reader(folder / f"board{suffix}", lambda path: list(read_pictures([path])), content)
    return found


def _picture(path: Path) -> None:
    if not isinstance(read_image(path), np.ndarray):
        raise SessionError(path.name, got="bytes that cannot be decoded", wanted="a picture")


def _others(folder: Path) -> dict[str, Reader]:
    site = (ROOT / "docs" / "site-example.toml").read_bytes()
    (folder / "docs").mkdir()
    station = (ROOT / "docs" / "station-example.toml").read_bytes()
    (folder / "nose.toml").write_text(NOSE)
    camera = load_nose_camera(folder / "nose.toml")
    (folder / "run").mkdir()
    rrd = folder / "seed.rrd"
    (folder / "run" / "track.csv").write_text(TRACK)
    write_results_recording(folder / "run", rrd, "run")
    one = b"image_size_px = [64, 48]\nfocal_px = [300.0, 300.0]\nprincipal_point_px = [31.5, 23.5]\n"
    return {
        "site.toml": _reader(folder / "site.toml", load_site, site),
        "station.toml": _reader(folder / "docs" / "station.toml", load_station, station),
        "world.toml": _reader(folder / "world.toml", load_world, world_text(draw_world(7)).encode()),
        "bank.toml": _reader(folder / "bank.toml", load_bank_settings, BANK.encode()),
        "runs.csv": _reader(folder / "runs.csv", require_log, (",".join(COLUMNS) + "\n").encode()),
        "faults.toml": _reader(folder / "faults.toml", load_faults, FAULTS.encode()),
        "lens.toml": _reader(folder / "lens.toml", read_lens, one),
        "lens.yaml": _reader(
            folder / "lens.yaml",
            lambda p: read_lens(p, "cam0"),
            KALIBR.encode(),
            ROS.format("[0, 0, 0, 0, 0]").encode(),
        ),
        "nose camera.toml": _reader(
            folder / "camera.toml", lambda p: (load_nose_camera(p), load_unit(p, camera)), NOSE.encode()
        ),
        "imu.csv": _reader(folder / "imu.csv", lambda p: load_imu(p, camera), IMU.encode()),
        "samples.csv": _reader(folder / "samples.csv", read_samples, IMU.encode()),
        "sightings.csv": _reader(folder / "sightings.csv", read_sightings, SIGHTINGS.encode()),
        "landmarks.csv": _reader(folder / "landmarks.csv", read_landmarks, LANDMARKS.encode()),
        "corners.csv": _reader(folder / "corners.csv", lambda p: list(read_corners(p)), CORNERS.encode()),
        "runways.json": _reader(folder / "runways.json", lambda p: Runways(p).find("LFRS", "03"), RUNWAYS.encode()),
        "flight log.csv": _reader(folder / "flight.csv", load_flight_log, FLIGHT.encode()),
        "track.csv": _reader(
            folder / "run" / "track.csv",
            lambda p: write_results_recording(p.parent, folder / "out.rrd", "run"),
            TRACK.encode(),
            slow=True,
        ),
        "ground track.csv": _reader(
            folder / "ground.csv", lambda p: read_ground_track(p, np.zeros(3), 1.0), TRACK.encode()
        ),
        "ground track.tum": _reader(
            folder / "ground.tum", lambda p: read_ground_track(p, np.zeros(3), 1.0), TUM.encode()
        ),
        "boxes.mp4": _reader(folder / "boxes.mp4", _boxes, (folder / "session" / "mp4" / "left.mp4").read_bytes()),
        "run.rrd": replace(
            _reader(folder / "run.rrd", check_recording, rrd.read_bytes(), slow=True),
            in_child=lambda: read_to_end(folder / "run.rrd"),
        ),
    }


def _boxes(path: Path) -> None:
    fault = mp4_fault(path)
    if fault:
        raise SessionError(path.name, got=fault, wanted="a whole video")


def _reader(path: Path, read: Callable[[Path], object], *seeds: bytes, slow: bool = False) -> Reader:
    return Reader(path=path, read=lambda: read(path), seeds=seeds, slow=slow)
