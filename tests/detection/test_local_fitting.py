"""Region-scalable fitting finds what means of the whole picture cannot, and is the plain model at a share of nought."""

import numpy as np
import pytest
from numpy.typing import NDArray

from groundstation.detection import chan_vese
from groundstation.detection.config import DetectionConfig, LevelSetConfig
from groundstation.detection.local_fitting import drive_field, evolve_local
from groundstation.detection.segmentation import make_segmenter

SHAPE = (70, 140)


def target() -> NDArray[np.bool_]:
    y, x = np.mgrid[0 : SHAPE[0], 0 : SHAPE[1]]
    return np.asarray(np.hypot((x - 75) / 2.0, y - 33) < 9, np.bool_)


def uneven(rng: np.random.Generator) -> NDArray[np.float32]:
    """A target half as bright again as its surroundings, under light that doubles across the picture."""
    light = np.linspace(0.3, 0.7, SHAPE[1])[None, :]
    picture = light * np.where(target(), 1.4, 1.0) + rng.normal(0, 0.01, SHAPE)
    return np.clip(picture, 0, 1).astype(np.float32)


def overlap(a: NDArray[np.bool_], b: NDArray[np.bool_]) -> float:
    return float((a & b).sum() / (a | b).sum())


def start() -> NDArray[np.float32]:
    y, x = np.mgrid[0 : SHAPE[0], 0 : SHAPE[1]]
    return np.asarray(np.where(np.hypot((x - 72) / 2.2, y - 31) < 10, 1.0, -1.0), np.float32)


def test_uneven_light_needs_local_means(rng: np.random.Generator) -> None:
    u = uneven(rng)
    weights = (0.002, 0.0, 1.0, 1.0)
    plain, local = start(), start()
    chan_vese.evolve(u, plain, weights, 1.0, 400.0, 300, 0.001, 2)
    evolve_local(u, local, weights, (1.0, 6.0), 1.0, 400.0, 300, 0.001, 2)
    assert overlap(plain > 0, target()) < 0.5
    assert overlap(local > 0, target()) > 0.9


def test_no_local_share_is_the_plain_model(rng: np.random.Generator) -> None:
    u = uneven(rng)
    weights = (0.02, 0.1, 1.3, 0.7)
    phi = start()
    c1, c2, _ = chan_vese.region_means(u, phi)
    expected = -0.1 - 1.3 * (u - c1) ** 2 + 0.7 * (u - c2) ** 2
    assert np.allclose(drive_field(u, phi, weights, (0.0, 6.0)), expected, atol=1e-6)
    swept, plain = start(), start()
    plainly = (0.02, 0.0, 1.0, 1.0)
    chan_vese.evolve(u, plain, plainly, 1.0, 50.0, 600, 0.0, 3)
    evolve_local(u, swept, plainly, (0.0, 6.0), 1.0, 50.0, 600, 0.0, 3)
    assert overlap(swept > 0, plain > 0) > 0.99


def test_local_misfit_equals_its_integral(rng: np.random.Generator) -> None:
    u = uneven(rng)
    phi = start()
    sigma = 3.0
    field = drive_field(u, phi, (0.0, 0.0, 1.0, 0.0), (1.0, sigma))
    y, x = 30, 70
    offset = np.arange(-20, 21)
    kernel = np.exp(-0.5 * (offset / sigma) ** 2)
    kernel /= kernel.sum()
    inside = phi > 0
    total = 0.0
    for dy, ky in zip(offset, kernel, strict=True):
        for dx, kx in zip(offset, kernel, strict=True):
            member = inside[y + dy - 9 : y + dy + 10, x + dx - 9 : x + dx + 10]
            window = np.outer(
                np.exp(-0.5 * (np.arange(-9, 10) / sigma) ** 2), np.exp(-0.5 * (np.arange(-9, 10) / sigma) ** 2)
            )
            weight = window * member
            share = weight.sum() / window.sum()
            mean = (weight * u[y + dy - 9 : y + dy + 10, x + dx - 9 : x + dx + 10]).sum() / max(weight.sum(), 1e-12)
            fit = mean if share > 1e-3 else u[inside].mean()
            total += ky * kx * (u[y, x] - fit) ** 2
    assert -field[y, x] == pytest.approx(total, rel=0.02)


def test_configuration_chooses_it(rng: np.random.Generator) -> None:
    u = uneven(rng)
    level = LevelSetConfig(local_share=1.0, local_sigma_px=6.0, mu=0.002, iterations=300)
    phi = make_segmenter(DetectionConfig(level_set=level))(u, start() > 0)
    assert overlap(phi > 0, target()) > 0.9


@pytest.mark.parametrize("values", [{"local_share": 1.5}, {"local_share": -0.1}, {"local_sigma_px": 0.0}])
def test_meaningless_values_are_refused(values: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="local_share must lie in"):
        LevelSetConfig(**values)  # type: ignore[arg-type]
