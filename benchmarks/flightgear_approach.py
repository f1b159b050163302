"""Pictures of an approach from FlightGear, an independent renderer, with its commanded poses, checked.

    python benchmarks/flightgear_approach.py [--out DIR] [--frames N] [--running]

Needs `apt install flightgear xvfb libgl1-mesa-dri dbus` (2.6 GB); ends with a message without them. FlightGear
runs headless with Mesa's software renderer over Keflavik, runway 29, whose corners are read from its own airport data.
Its ports are for the loopback only. `--running` uses one that was started before.

A pose is set over telnet and the picture fetched over HTTP until two in a row are the same. Whether the picture shows
the pose is tested by the runway's own corners: each picture's corners are measured near their projection.
DIR gets the pictures, poses.csv and checks.csv; none is part of this repository (FlightGear's scenery is GPL).
"""

import argparse
import csv
import gzip
import math
import os
import shutil
import signal
import socket
import subprocess
import time
import urllib.request
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from groundstation.geometry.camera import Lens
from groundstation.geometry.geodesy import enu_from_geodetic
from groundstation.onboard.edges.pose import Attitude, NoseCameraPose, intrinsic_matrix, nose_pose, pixels_from_points
from groundstation.onboard.pose.corners import refine_corners
from groundstation.onboard.pose.pose_solver import PointCorrespondences, solve_pose
from groundstation.onboard.pose.runway import rectangle

ROOT = Path("/usr/share/games/flightgear")
AIRPORT, LANDING, SIZE, FIELD_OF_VIEW_DEG = "BIKF", "29", (1280, 960), 30.0
FOOT_M = 0.3048
HTTP, TELNET = 8080, 5501
ARGUMENTS = (
    f"--fg-root={ROOT} --aircraft=ufo --airport={AIRPORT} --fdm=null --disable-terrasync --disable-sound "
    "--disable-splash-screen --disable-ai-traffic --disable-ai-models --disable-real-weather-fetch --disable-clouds3d "
    f"--start-date-gmt=2020:06:21:13:00:00 --httpd={HTTP} --telnet={TELNET} --geometry={SIZE[0]}x{SIZE[1]} "
    "--prop:/sim/rendering/multithreading-mode=SingleThreaded --allow-nasal-from-sockets "
    "--prop:/sim/rendering/shaders/quality-level=0 --prop:/sim/rendering/shaders/skydome=0 --disable-horizon-effect"
).split()


@dataclass(frozen=True, slots=True, kw_only=True)
class RunwayEnds:
    """Ends (latitude, longitude) in deg of a runway, the near one first, and its width in m."""

    near: tuple[float, float]
    far: tuple[float, float]
    width_m: float


class FlightGear:
    """A running FlightGear's properties and pictures."""

    def __init__(self) -> None:
        self._line = socket.create_connection(("127.0.0.1", TELNET), timeout=300)
        self._line.sendall(b"data\r\n")
        self._left = b""

    def put(self, **values: float) -> None:
        """Set properties by the names of `NAMES`."""
        for name, value in values.items():
            self._line.sendall(f"set {NAMES[name]} {value:.10f}\r\n".encode())

    def get(self, name: str) -> float:
        """Return a property that is a number."""
        self._line.sendall(f"get {name}\r\n".encode())
        while b"\n" not in self._left:
            self._left += self._line.recv(4096)
        line, self._left = self._left.split(b"\n", 1)
        return float(line.strip() or "nan")

    def picture(self) -> np.ndarray:
        """Return the picture once two in a row are the same."""
        last = None
        for _ in range(12):
            with urllib.request.urlopen(f"http://127.0.0.1:{HTTP}/screenshot?type=png", timeout=300) as answer:
                image = cv2.imdecode(np.frombuffer(answer.read(), np.uint8), cv2.IMREAD_COLOR)
            if last is not None and float(np.abs(image.astype(float) - last).mean()) < 0.2:
                return image
            last = image
        return last


NAMES = {
    "lat": "/position/latitude-deg",
    "lon": "/position/longitude-deg",
    "alt_ft": "/position/altitude-ft",
    "roll": "/orientation/roll-deg",
    "pitch": "/orientation/pitch-deg",
    "heading": "/orientation/heading-deg",
    "fov": "/sim/current-view/field-of-view",
    "x": "/sim/current-view/x-offset-m",
    "y": "/sim/current-view/y-offset-m",
    "z": "/sim/current-view/z-offset-m",
    "view_heading": "/sim/current-view/goal-heading-offset-deg",
    "view_pitch": "/sim/current-view/goal-pitch-offset-deg",
    "menu": "/sim/menubar/visibility",
    "frozen": "/sim/freeze/master",
}


def runway_ends() -> RunwayEnds:
    """Return the runway from FlightGear's own airport data."""
    inside = False
    with gzip.open(ROOT / "Airports" / "apt.dat.gz", "rt", encoding="utf-8", errors="replace") as file:
        for line in file:
            words = line.split()
            if words[:1] == ["1"]:
                inside = len(words) > 4 and words[4] == AIRPORT
            elif inside and words[:1] == ["100"]:
                ends = {words[k]: (float(words[k + 1]), float(words[k + 2])) for k in (8, 17)}
                if LANDING in ends:
                    (other,) = (place for name, place in ends.items() if name != LANDING)
                    return RunwayEnds(near=ends[LANDING], far=other, width_m=float(words[1]))
    raise SystemExit(f"no runway {LANDING} of {AIRPORT} in {ROOT}")


def far_end_enu(ends: RunwayEnds, far_m: float, near_m: float) -> np.ndarray:
    """Return the far end (3,) in m, east, north and up of the near end, from the heights of both in m."""
    lat_deg, lon_deg = ends.far
    return enu_from_geodetic(np.array([lat_deg]), np.array([lon_deg]), np.array([far_m]), (*ends.near, near_m))[0]


def fly(out: Path, frames: int) -> None:
    """Take the pictures, check the poses, write and print."""
    game, ends = FlightGear(), runway_ends()
    far = far_end_enu(ends, 0.0, 0.0)
    heading = math.atan2(far[0], far[1])
    runway = rectangle(float(np.hypot(*far[:2])), ends.width_m)
    game.put(fov=FIELD_OF_VIEW_DEG, x=0.0, y=0.0, z=0.0, view_heading=0.0, view_pitch=0.0, menu=0.0)
    ground_m, far_m = (elevation(game, place) for place in (ends.near, ends.far))
    corners_m = runway.corners_m.copy()
    # the far end's height over the near end's level, the earth's curvature with it
    corners_m[1:3, 2] = far_end_enu(ends, far_m, ground_m)[2]
    focal = 0.5 * SIZE[0] / math.tan(math.radians(0.5 * FIELD_OF_VIEW_DEG))
    lens = Lens(
        image_size_px=SIZE,
        focal_px=np.array([focal, focal]),
        principal_point_px=0.5 * (np.array(SIZE) - 1.0),
        distortion=np.zeros(5),
    )
    rng = np.random.default_rng(9)
    poses, checks = [], []
    for k in range(frames):
        away = 2500.0 * (0.25 ** (k / max(frames - 1, 1)))
        place = np.array([rng.normal(0.0, 0.01) * away, away, 0.06 * away + 8.0])
        roll, pitch, yaw = rng.normal(0.0, 2.0), rng.normal(-2.0, 0.7), rng.normal(0.0, 1.0)
        lat, lon = geodetic(ends.near, place, heading)
        game.put(
            lat=lat, lon=lon, alt_ft=(ground_m + place[2]) / FOOT_M, roll=roll, pitch=pitch,
            # north there is not north here
            heading=math.degrees(heading) + yaw + (lon - ends.near[1]) * math.sin(math.radians(lat)),
        )  # fmt: skip
        time.sleep(2.0)
        image = game.picture()
        name = f"{k:06d}.png"
        cv2.imwrite(str(out / name), image)
        attitude = Attitude(roll_rad=math.radians(roll), pitch_rad=math.radians(pitch), yaw_rad=math.radians(yaw))
        poses.append([name, *place, roll, pitch, yaw])
        checks.append([name, *check(image, nose_pose(place, attitude), corners_m, lens)])
        print(*(v if isinstance(v, str) else f"{v:.2f}" for v in checks[-1]), flush=True)
    write(out / "poses.csv", ("filename", "x_m", "y_m", "z_m", "roll_deg", "pitch_deg", "yaw_deg"), poses)
    header = ("filename", *(f"d{a}_{c}" for c in ("near_left", "far_left", "far_right", "near_right") for a in "uv"))
    write(out / "checks.csv", (*header, "dx_m", "dy_m", "dz_m"), checks)
    off = np.array([row[1:9] for row in checks], dtype=np.float64)
    found = np.isfinite(off).all(axis=1)
    print(f"thresholds at {ground_m:.2f} and {far_m:.2f} m; corners found in {found.sum()} of {frames} pictures")
    if found.any():
        print("median |measured - expected| by corner:", np.round(np.median(np.abs(off[found]), axis=0), 2).tolist())


def elevation(game: FlightGear, place: tuple[float, float]) -> float:
    """Return the scenery's height in m at a place, once it is loaded there."""
    game.put(lat=place[0], lon=place[1], alt_ft=600.0)
    last = math.nan
    for _ in range(30):
        time.sleep(2.0)
        now = game.get("/position/ground-elev-m")
        if now == last and now > -100.0:
            return now
        last = now
    return last


def geodetic(origin: tuple[float, float], place: np.ndarray, heading: float) -> tuple[float, float]:
    """Return latitude and longitude of a place in the threshold frame, by Newton's steps on WGS 84."""
    s, c = math.sin(heading), math.cos(heading)
    east, north = -c * place[0] - s * place[1], s * place[0] - c * place[1]
    lat, lon = origin
    for _ in range(5):
        at = enu_from_geodetic(np.array([lat]), np.array([lon]), np.array([0.0]), (*origin, 0.0))[0]
        lat += (north - at[1]) / 111_300.0
        lon += (east - at[0]) / (111_300.0 * math.cos(math.radians(lat)))
    return lat, lon


def check(image: np.ndarray, pose: NoseCameraPose, corners_m: np.ndarray, lens: Lens) -> list[float]:
    """Return the distances of the measured corners from their projection (8), and the pose from them (3) m."""
    expected = pixels_from_points(pose, intrinsic_matrix(lens), corners_m)
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY).astype(np.float64)
    found = refine_corners(grey, expected, 5.0) if np.isfinite(expected).all() else None
    if found is None:
        return [math.nan] * 11
    seen = PointCorrespondences(
        points_m=corners_m, pixels=found.pixels, covariance_px2=found.covariance_px2 + 0.25 * np.eye(2), lens=lens
    )
    solved = solve_pose(seen)
    by_corners = [math.nan] * 3 if solved is None else (solved.position_m - pose.camera_threshold_m).tolist()
    return [*(found.pixels - expected).ravel().tolist(), *by_corners]


def write(path: Path, columns: tuple[str, ...], rows: list) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([columns, *rows])


def main() -> None:
    """Start the required programs, fly, and stop them again."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out/flightgear"))
    parser.add_argument("--frames", type=int, default=12)
    parser.add_argument("--running", action="store_true", help="use a FlightGear that listens already")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    if options.running:
        fly(options.out, options.frames)
        return
    game = shutil.which("fgfs") or shutil.which("fgfs", path="/usr/games")
    if game is None or shutil.which("Xvfb") is None or shutil.which("dbus-run-session") is None:
        print("skipped: needs apt packages flightgear, xvfb, libgl1-mesa-dri, dbus")
        return
    environment = {
        **os.environ, "DISPLAY": ":78", "LIBGL_ALWAYS_SOFTWARE": "1", "LP_NUM_THREADS": "1",
        "QT_QPA_PLATFORM": "offscreen", "HOME": str(options.out.resolve()),
    }  # fmt: skip
    size = f"{SIZE[0]}x{SIZE[1]}x24"
    screen = subprocess.Popen(["Xvfb", ":78", "-screen", "0", size, "+extension", "GLX"], stderr=subprocess.DEVNULL)
    with (options.out / "flightgear.log").open("w") as log:
        time.sleep(10.0)
        simulator = subprocess.Popen(
            ["dbus-run-session", "--", game, *ARGUMENTS], env=environment, stdout=log, stderr=log,
            start_new_session=True,
        )  # fmt: skip
        try:
            wait(600.0)
            fly(options.out, options.frames)
        finally:
            # dbus-run-session does not hand the signal on
            os.killpg(simulator.pid, signal.SIGTERM)
            simulator.wait(60)
            screen.terminate()
            screen.wait(30)


def wait(longest_s: float) -> None:
    """Wait until it gives pictures."""
    until = time.monotonic() + longest_s
    while time.monotonic() < until:
        try:
            urllib.request.urlopen(f"http://127.0.0.1:{HTTP}/screenshot?type=png", timeout=60).read()
            return
        except OSError:
            time.sleep(5.0)
    raise SystemExit("FlightGear gave no picture")


if __name__ == "__main__":
    main()
