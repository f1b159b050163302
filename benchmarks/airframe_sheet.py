"""Drawn airframes on one sheet, each seen from ahead, the side, above, behind, and as a station sees it far away.

    python benchmarks/airframe_sheet.py OUT.png [--count N] [--first SEED] [--family NAME ...]

The pictures are those of a station's camera over the usual scenery, with a long lens for the close views. Each row is
the airframe of a seed; its family and its span are written there.
"""

import argparse
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from groundstation.arrays import ImageArray
from groundstation.geometry.aim import aim_at
from groundstation.geometry.camera import Lens
from groundstation.simulation.airframes.airframe import Airframe
from groundstation.simulation.airframes.build import build_airframe
from groundstation.simulation.airframes.draw import draw_airframe
from groundstation.simulation.airframes.kinds import FAMILIES, AirframeFamily
from groundstation.simulation.airframes.spec import AirframeSpec
from groundstation.simulation.attitude import AircraftPose
from groundstation.simulation.flights import site_rig
from groundstation.simulation.optics import Optics
from groundstation.simulation.rendered_camera import RenderedCamera
from groundstation.simulation.rendered_scene import RenderedScene
from groundstation.simulation.scenery import Scenery, surroundings_of
from groundstation.simulation.trajectory import SampledTrajectory

_TILE_PX = (300, 220)
# heading from straight towards the stations, nose up, right wing down, in degrees
_ASPECTS = ((0.0, 4.0, 0.0), (90.0, 3.0, 0.0), (90.0, 0.0, -80.0), (-40.0, -12.0, 0.0), (-145.0, 4.0, 15.0))
_SPANS_ACROSS = 1.35
_DISTANCE_M = 60.0
_FAR = ((30.0, 5.0, -10.0), 8.0)
_HEIGHT_M = 9.0
_COLUMNS = 2


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeldScene(RenderedScene):
    """A scene whose aircraft is held in an attitude: heading, nose up, right wing down, in degrees."""

    attitude_deg: tuple[float, float, float]

    def aircraft_at(self, t_s: float) -> AircraftPose:
        """Return the aircraft's pose at a time, s."""
        heading, pitch, bank = (math.radians(v) for v in self.attitude_deg)
        towards = np.array([math.sin(heading), -math.cos(heading), 0.0])
        forward = math.cos(pitch) * towards + math.sin(pitch) * np.array([0.0, 0.0, 1.0])
        level = np.array([towards[1], -towards[0], 0.0])
        right = math.cos(bank) * level + math.sin(bank) * np.cross(forward, level)
        axes = np.column_stack([forward, right, np.cross(forward, right)])
        middle = np.array([0.0, _DISTANCE_M, _HEIGHT_M])
        # the camera points at the middle of the aircraft, not at its nose
        corners = self.airframe.corners_body_m.reshape(-1, 3)
        offset = axes @ (0.5 * (corners.min(axis=0) + corners.max(axis=0)))
        return AircraftPose(
            position_runway_m=middle - offset, velocity_runway_m_s=20.0 * forward, runway_from_body=axes
        )


class _Studio:
    """Renders airframes; the surroundings are drawn once."""

    def __init__(self) -> None:
        self._station = site_rig()["left"]
        eye = self._station.geometry().camera_pose(0.0, 0.0).position_runway_m
        self._scenery = Scenery(cloud_cover=0.3)
        self._around = surroundings_of(self._scenery, eye, 1500.0, False)
        self._range_m = float(np.linalg.norm(eye - [0.0, _DISTANCE_M, _HEIGHT_M]))

    def look(self, airframe: Airframe, attitude_deg: tuple[float, float, float], smaller: float = 1.0) -> ImageArray:
        """Return the picture (h, w, 3) in which it is so much smaller than it would fit."""
        size_m = max(airframe.span_m, float(np.ptp(airframe.corners_body_m[:, :, 0])))
        focal = _TILE_PX[0] * self._range_m / (size_m * _SPANS_ACROSS * smaller)
        lens = Lens(
            image_size_px=_TILE_PX,
            focal_px=np.array([focal, focal]),
            principal_point_px=0.5 * np.array(_TILE_PX),
            distortion=np.zeros(5),
        )
        station = replace(self._station, lens=lens)
        still = np.zeros((2, 3))
        place = np.array([[0.0, _DISTANCE_M, _HEIGHT_M]] * 2)
        held = HeldScene(
            trajectory=SampledTrajectory(t_s=np.array([-5.0, 5.0]), position_m=place, velocity_m_s=still),
            airframe=airframe,
            scenery=self._scenery,
            attitude_deg=attitude_deg,
        )
        aim = aim_at(station.geometry(), place[0])
        if aim is None:
            raise SystemExit("the station cannot be aimed at the aircraft")
        camera = RenderedCamera(held, station, Optics(), around=self._around)
        raw = camera.picture(0.0, aim.pan_rad, aim.tilt_rad)
        return np.asarray(raw.whole(), np.uint8)


def row(studio: _Studio, seed: int, spec: AirframeSpec) -> ImageArray:
    """Return an airframe's pictures, one next to the other, with its name."""
    airframe = build_airframe(spec)
    tiles = [studio.look(airframe, attitude) for attitude in _ASPECTS]
    tiles.append(studio.look(airframe, *_FAR))
    strip = np.ascontiguousarray(np.hstack(tiles))
    words = (
        f"{seed} {spec.family} {spec.span_m:.1f} m, {spec.tail.kind} tail, {spec.propeller.kind}, {spec.gear.kind}, "
        f"{len(airframe.opacity)} triangles, rest {airframe.rest_height_m:.2f} m"
    )
    cv2.putText(strip, words, (6, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (20, 20, 20), 1, cv2.LINE_AA)
    return strip


def sheet(specs: Sequence[tuple[int, AirframeSpec]], columns: int) -> ImageArray:
    """Return the rows of all airframes, in so many columns."""
    studio = _Studio()
    rows = [row(studio, seed, spec) for seed, spec in specs]
    while len(rows) % columns:
        rows.append(np.full_like(rows[0], 255))
    height = len(rows) // columns
    return np.hstack([np.vstack(rows[k * height : (k + 1) * height]) for k in range(columns)])


def main() -> None:
    """Draw the airframes and write the sheet."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, metavar="OUT.png")
    parser.add_argument("--count", type=int, default=54)
    parser.add_argument("--first", type=int, default=0, metavar="SEED")
    parser.add_argument("--family", nargs="+", choices=FAMILIES, default=FAMILIES, metavar="NAME")
    parser.add_argument("--columns", type=int, default=_COLUMNS)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    families = [AirframeFamily(name) for name in options.family]
    seeds = range(options.first, options.first + options.count)
    # one family after the other, so that each occurs equally often
    specs = [
        (seed, draw_airframe(np.random.default_rng(seed), [families[k % len(families)]]))
        for k, seed in enumerate(seeds)
    ]
    options.out.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(options.out), sheet(specs, options.columns))


if __name__ == "__main__":
    main()
