"""The compiled loops over pixels give what the station's model gives for each of them."""

import numpy as np

from groundstation.geometry.ray_kernels import fill_centre_shifts, fill_rays
from tests.stereo_rig import make_rig

FAR_M = 1e7


def test_rays_are_those_of_the_station(rng: np.random.Generator) -> None:
    """Expected: as one by one; what has no finite pixel or angles is left as it was."""
    geometry = make_rig(fixed=False).stations[0].geometry()
    w, h = geometry.image_size_px
    pixels, angles = rng.uniform(0.0, [w, h], (20, 2)), rng.uniform(-0.3, 0.3, (20, 2))
    pixels[3, 1], angles[5, 0] = np.nan, np.inf
    origins, rays = np.full((20, 3), 7.0), np.full((20, 3), 7.0)
    fill_rays(geometry.packed, pixels, angles, origins, rays)
    for k in range(20):
        if k in (3, 5):
            assert np.all(origins[k] == 7.0)
            assert np.all(rays[k] == 7.0)
            continue
        single = geometry.ray(*pixels[k], *angles[k])
        np.testing.assert_allclose(origins[k], single.origin_runway_m, rtol=0, atol=1e-12)
        np.testing.assert_allclose(rays[k], single.direction_runway, rtol=0, atol=1e-12)


def test_shifts_of_the_centre_are_those_of_a_distant_point(rng: np.random.Generator) -> None:
    """Expected: as ray and projection give them; no number without angles, infinite where the head turned away."""
    geometry = make_rig(fixed=False).stations[0].geometry()
    first, shifts = rng.uniform(-0.1, 0.1, (20, 2)), np.zeros((20, 2))
    second = first + rng.uniform(-0.02, 0.02, (20, 2))
    second[4, 1], second[6, 0] = np.nan, first[6, 0] + np.pi
    fill_centre_shifts(geometry.packed, first, second, FAR_M, shifts)
    centre = geometry.lens.principal_point_px
    for k in range(20):
        ray = geometry.ray(*centre, *first[k])
        seen = geometry.project(ray.origin_runway_m + FAR_M * ray.direction_runway, *second[k])
        if k == 4:
            assert np.isnan(shifts[k]).all()
        elif k == 6:
            assert seen is None
            assert np.isinf(shifts[k]).all()
        else:
            assert seen is not None
            np.testing.assert_allclose(shifts[k], seen.pixel - centre, rtol=0, atol=1e-9)
    still = np.zeros((1, 2))
    fill_centre_shifts(geometry.packed, still, still, FAR_M, shifts[:1])
    np.testing.assert_allclose(shifts[0], 0.0, atol=1e-6)
