"""Directions of a picture's pixels are those of the station's geometry."""

from dataclasses import replace

import numpy as np
import pytest

from groundstation.arrays import FloatArray
from groundstation.geometry.rotation import matrix_from_wxyz
from groundstation.registration.panorama import PictureRays
from groundstation.rig.ptu_axes import PtuAxes
from groundstation.rig.rig import Station
from tests.stereo_rig import make_station

PAN, TILT = 0.4, 0.1


def leaning(readout_s: float = 0.0) -> Station:
    """A wide lens, so that a pixel is a tenth of a degree, and a tilt axis that leans by 2°."""
    station = make_station("left", -5.0)
    lens = replace(station.lens, focal_px=np.array([600.0, 640.0]), principal_point_px=np.array([630.0, 485.0]))
    return replace(station, lens=lens, ptu_axes=PtuAxes(lean_rad=np.radians(2.0)), readout_s=readout_s)


def by_geometry(station: Station, pixel: FloatArray, pan_rad: float, tilt_rad: float) -> FloatArray:
    """Return azimuth and height of a pixel (2,), rad, in the base frame."""
    ray = station.geometry().ray(float(pixel[0]), float(pixel[1]), pan_rad, tilt_rad)
    x, y, z = matrix_from_wxyz(station.runway_from_base_wxyz).T @ ray.direction_runway
    return np.array([np.arctan2(-x, y), np.arcsin(z)])


@pytest.mark.parametrize("place", [(0, 0), (639, 0), (320, 240), (100, 479)])
def test_a_halved_pixel_looks_where_the_middle_of_its_four_does(place: tuple[int, int]) -> None:
    """A panorama that is made and read a pixel aside fits itself, and turns all heads by as much."""
    station = leaning()
    rays, number = PictureRays(station), np.array([place[1] * 640 + place[0]])
    found = rays.directions(rays.rays[number], PAN, TILT)[0]
    expected = by_geometry(station, 2.0 * np.array(place) + 0.5, PAN, TILT)
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_a_head_that_turns_has_each_rows_own_angles() -> None:
    station, rates = leaning(readout_s=0.03), np.array([0.5, -0.3])
    rays, number = PictureRays(station), np.array([40 * 640 + 600])
    turned = rays.turned(rates, number)
    assert turned is not None
    found = rays.directions(rays.rays[number], PAN, TILT, turned)[0]
    pixel = 2.0 * np.array([600.0, 40.0]) + 0.5
    pan_rad, tilt_rad = np.array([PAN, TILT]) + rates * rays.delay_s[number[0]]
    np.testing.assert_allclose(found, by_geometry(station, pixel, pan_rad, tilt_rad), atol=1e-9)
