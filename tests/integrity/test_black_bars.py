"""Bars that a converter adds, and dark pictures without any."""

import re
from collections.abc import Callable

import cv2
import numpy as np
import pytest

from groundstation.arrays import ImageArray
from groundstation.integrity.black_bars import BlackBarsMonitor
from groundstation.messages import Frame
from groundstation.picture import BgrPicture

SIZE = (640, 480)
Scene = Callable[[int, np.random.Generator], ImageArray]


def sky(k: int, rng: np.random.Generator) -> ImageArray:
    grey = 150.0 + 20.0 * np.sin((np.arange(SIZE[0]) + 7.0 * k) / 60.0) + np.linspace(-20.0, 20.0, SIZE[1])[:, None]
    return np.clip(grey + rng.normal(0.0, 3.0, grey.shape), 0.0, 255.0).astype(np.uint8)


def with_bars(image: ImageArray, sides: int, above: int, level: int = 0) -> ImageArray:
    padded = np.full_like(image, level)
    small = cv2.resize(image, (SIZE[0] - 2 * sides, SIZE[1] - 2 * above))
    padded[above : SIZE[1] - above, sides : SIZE[0] - sides] = small
    return padded


def lines_of(scene: Scene, rng: np.random.Generator, quality: int = 90, pictures: int = 20) -> list[str]:
    monitor = BlackBarsMonitor(["left"])
    for k in range(pictures):
        coded = cv2.imencode(".jpg", scene(k, rng), [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
        image = np.asarray(cv2.imdecode(coded, cv2.IMREAD_COLOR), np.uint8)
        list(monitor.watched([Frame(t_s=0.5 * k, station="left", epoch=k, image=BgrPicture(image))]))
    return monitor.lines()


@pytest.mark.parametrize("level", [0, 16])
@pytest.mark.parametrize(("sides", "above", "where"), [(80, 0, "left and right"), (0, 60, "above and below")])
@pytest.mark.parametrize("quality", [95, 60])
def test_bars_are_told(rng: np.random.Generator, level: int, sides: int, above: int, where: str, quality: int) -> None:
    (line,) = lines_of(lambda k, r: with_bars(sky(k, r), sides, above, level), rng, quality)
    found = re.match(r"station left: black bars of (\d+) px (.*) in all pictures", line)
    assert found is not None
    # a codec blurs the end
    assert int(found[1]) == pytest.approx(max(sides, above), abs=2)
    assert found[2] == where


def night(k: int, rng: np.random.Generator) -> ImageArray:
    """A dark sky with the lights of a runway in the middle."""
    image = np.clip(rng.normal(2.0, 2.0, SIZE[::-1]), 0.0, 255.0).astype(np.uint8)
    for light in range(8):
        cv2.circle(image, (260 + 15 * light, 300 + k % 3), 3, 255, -1)
    return image


def black(k: int, rng: np.random.Generator) -> ImageArray:
    return np.full(SIZE[::-1], 16, dtype=np.uint8)


def vignette(k: int, rng: np.random.Generator) -> ImageArray:
    """A lens whose picture is a circle, with soft borders."""
    x, y = np.meshgrid(np.linspace(-1.0, 1.0, SIZE[0]), np.linspace(-0.75, 0.75, SIZE[1]))
    share = np.clip(6.0 * (0.85 - np.hypot(x, y)), 0.0, 1.0)
    return (share * sky(k, rng)).astype(np.uint8)


def ground(k: int, rng: np.random.Generator) -> ImageArray:
    """A night sky above bright ground."""
    image = np.zeros(SIZE[::-1], dtype=np.uint8)
    image[300:] = sky(k, rng)[300:]
    return image


def one_side(k: int, rng: np.random.Generator) -> ImageArray:
    """A dark pole at one border."""
    image = sky(k, rng)
    image[:, :60] = 5
    return image


@pytest.mark.parametrize("scene", [sky, night, black, vignette, ground, one_side])
def test_pictures_without_bars_are_not_accused(rng: np.random.Generator, scene: Scene) -> None:
    assert lines_of(scene, rng) == []


def test_a_wall_that_passes_is_no_bar(rng: np.random.Generator) -> None:
    """Expected: dark at both sides in one picture alone says nothing, and neither do few pictures."""
    assert lines_of(lambda k, r: with_bars(sky(k, r), 80, 0) if k == 3 else sky(k, r), rng) == []
    assert lines_of(lambda k, r: with_bars(sky(k, r), 80, 0), rng, pictures=4) == []
