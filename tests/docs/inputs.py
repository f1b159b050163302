"""Small inputs under the names that the documentation's commands use."""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from landmark_study.simulated import look as look_at_landmarks
from landmark_study.simulated import morning, write_landmarks, write_sightings

from calibration.lens.boards import parse_board
from calibration.lens.fit import camera_matrix
from groundstation.onboard.pose.pose_files import Runways
from groundstation.onboard.render import render_flight
from groundstation.replay.replay import ReplayRequest, replay
from groundstation.rig.rig import Rig
from groundstation.rig.rig_toml import rig_to_toml
from groundstation.simulation import Scenario, StationErrors, case_b, perturbed, simulate
from groundstation.simulation.approach import GlideApproach
from groundstation.simulation.dgps import DgpsModel
from groundstation.simulation.session_folder import write_session_folder
from tests.calibration.clocks.swings import Recorder, Swing, small_station, write_session
from tests.calibration.flight.flights import unknown
from tests.calibration.lens.boards_seen import Pose, a_lens, a_pose, render
from tests.calibration.mount.mounts import look, marks_around, plain_station, spoiled
from tests.docs.pages import ROOT
from tests.onboard.pose.approaches import LENS, pose_on_approach, project
from tests.onboard.pose.test_pose_command import CAMERA, write_runways
from tests.replay.test_learning import LANDING, wrong_rig
from tests.session.folder import rig_text, write_video
from tests.session.logs.writers import with_checksum
from tests.simulation.small_site import small_rig

_BOARD = "charuco:7x5:0.04:0.03"


def prepare(folder: Path, name: str) -> None:
    """Write the inputs ``name``, the folder of a `run in`, below ``folder``; '.' is what every page has."""
    _MAKERS[name](folder / name, np.random.default_rng(7))


def _always(folder: Path, rng: np.random.Generator) -> None:
    (folder / "recordings").symlink_to(ROOT / "recordings")
    (folder / "docs").symlink_to(ROOT / "docs")
    (folder / "small.toml").write_text(rig_to_toml(small_rig()))


def _lens(folder: Path, rng: np.random.Generator) -> None:
    board, lens = parse_board(_BOARD), a_lens((480, 360), focal_px=520.0)
    (folder / "shots").mkdir(parents=True)
    for k in range(10):
        cv2.imwrite(str(folder / "shots" / f"{k:02d}.png"), render(rng, board, lens, a_pose(rng, board, lens)))
    (folder / "rig.toml").write_text(rig_to_toml(Rig(stations=(plain_station(),))))


def _mount(folder: Path, rng: np.random.Generator) -> None:
    station = plain_station()
    true = spoiled(station, rng)
    marks = marks_around(true, rng)
    seen = look(true, marks, rng, 80)
    rows = ["station,landmark,pan_deg,tilt_deg,u_px,v_px,pan_from,tilt_from"]
    for k in range(len(seen)):
        row = [*np.degrees(seen.reading_rad[k]), *seen.pixel_px[k], *seen.sense[k]]
        rows.append(f"left,{marks[seen.mark[k]].name}," + ",".join(f"{v:.6g}" for v in row))
    places = ["landmark,x_m,y_m,z_m,sigma_x_m,sigma_y_m,sigma_z_m,kind"]
    for mark in marks:
        values = [*mark.place_m, *mark.sigma]
        kind = "direction" if "direction" in mark.kind.value else "point"
        places.append(f"{mark.name}," + ",".join(f"{v:.9f}" for v in values) + f",{kind}")
    folder.mkdir()
    (folder / "sightings.csv").write_text("\n".join(rows) + "\n")
    (folder / "landmarks.csv").write_text("\n".join(places) + "\n")
    (folder / "rig.toml").write_text(rig_to_toml(Rig(stations=(station,))))


def _board(folder: Path, rng: np.random.Generator) -> None:
    """A head whose readings are off by nothing but noise, before a board that stands still, its front towards it."""
    board, lens = parse_board(_BOARD), replace(a_lens((480, 360), focal_px=2250.0), distortion=np.zeros(5))
    station = replace(plain_station(), lens=lens, ptu_sigma_rad=np.radians(0.002), ptu_resolution_rad=0.0)
    geometry, corners = station.geometry(), board.corners_m
    # the board's x is the runway's, its y goes down
    runway_from_board = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    away_m, above_m = 4.0, 0.8
    middle = station.ptu_position_m + np.array([0.0, away_m, above_m])
    places = middle + (corners - corners.mean(axis=0)) @ runway_from_board.T
    (folder / "shots").mkdir(parents=True)
    rows = ["file,station,pan_deg,tilt_deg,pan_from,tilt_from"]
    for k in range(16):
        angles = np.array([0.0, np.arctan2(above_m, away_m)]) + np.radians(rng.uniform(-1.2, 1.2, 2))
        seen = [geometry.project(place, *angles) for place in places]
        pixels = np.array([projection.pixel for projection in seen if projection is not None])
        # the same view once more, as the pose that the picture is drawn by
        solved, rotation, translation = cv2.solvePnP(corners, pixels, camera_matrix(lens), lens.distortion)
        assert solved
        pose = Pose(rotation=rotation.ravel(), translation_m=translation.ravel())
        cv2.imwrite(str(folder / "shots" / f"{k:02d}.png"), render(rng, board, lens, pose))
        reading = np.degrees(angles) + 0.002 * rng.normal(size=2)
        sense = rng.choice([-1, 1], 2)
        rows.append(f"{k:02d}.png,left,{reading[0]:.6f},{reading[1]:.6f},{sense[0]},{sense[1]}")
    (folder / "shots" / "pictures.csv").write_text("\n".join(rows) + "\n")
    (folder / "rig.toml").write_text(rig_to_toml(Rig(stations=(station,))))


def _clocks(folder: Path, rng: np.random.Generator) -> None:
    how = Recorder(seconds=3.0, frame_hz=15.0, offset_s=0.040)
    write_session(folder / "swing", [small_station()], Swing(pan_deg=3.0, pan_hz=0.5), how, rng)


def _strip(folder: Path, rng: np.random.Generator) -> None:
    day = morning(rng)
    folder.mkdir()
    (folder / "lenses.toml").write_text(rig_to_toml(day.stated))
    write_landmarks(folder / "landmarks.csv", day.table)
    for name in ("sightings.csv", "today.csv"):
        write_sightings(folder / name, look_at_landmarks(day.true, day.stands, rng, 10))


def _short_flight() -> Scenario:
    return replace(case_b(seed=3, trajectory=GlideApproach(start_y_m=350.0, end_y_m=200.0)), dgps=DgpsModel())


def _flight(folder: Path, rng: np.random.Generator) -> None:
    scenario = _short_flight()
    scenario = replace(scenario, rig=unknown(scenario.rig, "orientation"))
    folder.mkdir()
    write_session_folder(folder / "session", simulate(scenario), name="simulated")


def _import(folder: Path, rng: np.random.Generator) -> None:
    """Two videos of two seconds, angles, and a receiver's sentences from a place 150 m before the stations."""
    folder.mkdir()
    for name in ("left", "right"):
        write_video(folder / f"{name}.mp4", range(20), "mp4v")
    (folder / "rig.toml").write_text(rig_text(("left", "right")))
    rows = [f"{0.05 * k:.2f},0,1,0,1" for k in range(60)]
    head = "t_s,left_pan_deg,left_tilt_deg,right_pan_deg,right_tilt_deg"
    (folder / "angles.csv").write_text("\n".join([head, *rows]) + "\n")
    sentences = []
    for tenths in range(2, 25, 2):
        time, place = f"0930{tenths / 10:05.2f}", "4723.86400,N,00832.61400,E"
        sentences.append(with_checksum(f"GPRMC,{time},A,{place},40.0,271.0,170526,,,A"))
        sentences.append(with_checksum(f"GPGGA,{time},{place},4,12,0.8,420.0,M,47.8,M,1.0,0001"))
    (folder / "flight.nmea").write_bytes(b"".join(sentences))


def _landing(folder: Path, rng: np.random.Generator) -> None:
    """The first 25 frames of the bundled landing's videos, and its other files as they are."""
    short = folder / "recordings" / "landing-1"
    short.mkdir(parents=True)
    for name in ("rig.toml", "ptu.csv"):
        (short / name).symlink_to(LANDING / name)
    (folder / "recordings" / "receiver.nmea").symlink_to(ROOT / "recordings" / "receiver.nmea")
    for name in ("left.mp4", "right.mp4"):
        whole = cv2.VideoCapture(str(LANDING / name))
        size = (int(whole.get(cv2.CAP_PROP_FRAME_WIDTH)), int(whole.get(cv2.CAP_PROP_FRAME_HEIGHT)))
        video = cv2.VideoWriter(str(short / name), cv2.VideoWriter.fourcc(*"mp4v"), 10.0, size)
        for _ in range(25):
            decoded, picture = whole.read()
            assert decoded
            video.write(picture)
        video.release()
        whole.release()


def _exchanged(folder: Path, rng: np.random.Generator) -> None:
    """The bundled landing, the columns of left and right in its table of angles exchanged."""
    session = folder / "session"
    session.mkdir(parents=True)
    for file in LANDING.iterdir():
        if file.name != "ptu.csv" and file.is_file():
            (session / file.name).symlink_to(file)
    head, *rows = (LANDING / "ptu.csv").read_text().splitlines()
    other = {"left": "right", "right": "left"}
    names = [
        "_".join([other.get(station, station), *rest]) for station, *rest in (n.split("_") for n in head.split(","))
    ]
    (session / "ptu.csv").write_text("\n".join([",".join(names), *rows]) + "\n")


def _field(folder: Path, rng: np.random.Generator) -> None:
    """A recording as `live` leaves it, of five pairs of frames."""
    kept = folder / "flights" / "2025-06-21T10-30-00Z"
    kept.mkdir(parents=True)
    replay(ReplayRequest(session=LANDING, out=folder / "r", record=kept / "flight.mcap", to_s=0.9, rerun=False))


def _stated_rig(folder: Path, rng: np.random.Generator) -> None:
    """A flight whose rig was assumed a tenth of a degree off, with that sigma."""
    scenario = _short_flight()
    turns = {name: StationErrors(mount_rad=np.radians(rng.normal(0.0, 0.05, 3))) for name in scenario.rig.names}
    known = {
        "covariance_parameters": tuple(f"runway_from_base.{axis}" for axis in "xyz"),
        "covariance": np.eye(3) * np.radians(0.1) ** 2,
    }
    stated = perturbed(scenario.rig, turns)
    stated = replace(stated, stations=tuple(replace(s, **known) for s in stated.stations))
    folder.mkdir()
    write_session_folder(folder / "session", simulate(scenario), name="simulated")
    (folder / "stated.toml").write_text(rig_to_toml(stated))


def _taught(folder: Path, rng: np.random.Generator) -> None:
    folder.mkdir()
    (folder / "recordings").symlink_to(ROOT / "recordings")
    wrong_rig(folder, admitted=True).rename(folder / "calibrated.toml")


def _runs(folder: Path, rng: np.random.Generator) -> None:
    """The results of one flight, on two days."""
    flight = simulate(case_b(seed=5, trajectory=GlideApproach(start_y_m=300.0, end_y_m=260.0)))
    write_session_folder(folder / "session", flight, name="monday")
    replay(ReplayRequest(session=folder / "session", out=folder / "out" / "monday"))
    shutil.copytree(folder / "out" / "monday", folder / "out" / "tuesday")


def _pose(folder: Path, rng: np.random.Generator) -> None:
    folder.mkdir()
    (folder / "nose.toml").write_text(CAMERA)
    runway = Runways(write_runways(folder / "runways_database.json")).find("ABCD", "36")
    rows = ["filename," + ",".join(f"{axis}_{name}" for name in "ABCD" for axis in "xy")]
    for k in range(3):
        pixels = project(runway.corners_m, *pose_on_approach(rng), LENS)
        rows.append(f"ABCD_36_{k}.png," + ",".join(f"{value:.6f}" for value in pixels.ravel()))
    (folder / "corners.csv").write_text("\n".join(rows) + "\n")


def _stars(folder: Path, rng: np.random.Generator) -> None:
    folder.mkdir(parents=True)


def _nose(folder: Path, rng: np.random.Generator) -> None:
    video, *_ = render_flight(folder, 0, 1, frames=2)
    video.rename(folder / "nose.mp4")


_MAKERS: dict[str, Callable[[Path, np.random.Generator], None]] = {
    ".": _always,
    "lens": _lens,
    "mount": _mount,
    "board": _board,
    "clocks": _clocks,
    "strip": _strip,
    "flight": _flight,
    "import": _import,
    "landing": _landing,
    "exchanged": _exchanged,
    "field": _field,
    "stated": _stated_rig,
    "taught": _taught,
    "runs": _runs,
    "pose": _pose,
    "nose": _nose,
    "stars": _stars,
}
