"""Colours of a figure are distinguishable without one kind of cone, too."""

import itertools

import numpy as np
import pytest
from skimage.color import deltaE_ciede2000, rgb2lab

from groundstation.evaluation import figure_style
from groundstation.experiments.detection_plots import COLOURS
from groundstation.viewer import entity_paths
from groundstation.viewer.comparison_recording import RUN_COLOURS

# Machado, Oliveira and Fernandes 2009, table 1, whole severity: linear RGB to linear RGB
VISIONS = {
    "all cones": np.eye(3),
    "protanopia": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "deuteranopia": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
    "tritanopia": np.array(
        [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]]
    ),
}
# a difference that is seen at a glance, in steps of which one is just seen side by side
APART = 10.0


def from_hex(*colours: str) -> np.ndarray:
    return np.array([[int(colour[k : k + 2], 16) for k in (1, 3, 5)] for colour in colours])


PALETTES = {
    "report": from_hex(
        figure_style.EKF,
        figure_style.TRIANGULATION,
        figure_style.DGPS,
        figure_style.TRUTH,
        figure_style.BOUND,
        figure_style.SMOOTHED,
    ),
    "experiments": from_hex(*COLOURS),
    "runs in Rerun": np.array(RUN_COLOURS),
    "tracks in Rerun": np.array(
        [
            entity_paths.EKF_COLOUR,
            entity_paths.TRIANGULATION_COLOUR,
            entity_paths.DGPS_COLOUR,
            entity_paths.TRUTH_COLOUR,
            entity_paths.SMOOTHED_COLOUR,
        ]
    ),
}


def least_difference(colours: np.ndarray, vision: np.ndarray) -> float:
    """Return the least CIEDE2000 of any two colours (n, 3), 0 to 255, as they are seen."""
    share = colours / 255.0
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    seen = np.clip(linear @ vision.T, 0.0, 1.0)
    lab = rgb2lab(np.where(seen <= 0.0031308, 12.92 * seen, 1.055 * seen ** (1 / 2.4) - 0.055)[None])[0]
    return min(float(deltaE_ciede2000(a, b)) for a, b in itertools.combinations(lab, 2))


@pytest.mark.parametrize("vision", VISIONS)
@pytest.mark.parametrize("palette", PALETTES)
def test_any_two_colours_are_distinguishable(palette: str, vision: str) -> None:
    assert least_difference(PALETTES[palette], VISIONS[vision]) >= APART


@pytest.mark.parametrize(
    ("vision", "colours"),
    [
        ("protanopia", from_hex("#CC3311", "#5E5A10")),
        ("deuteranopia", from_hex("#CC79A7", "#9193A6")),
        ("tritanopia", from_hex("#3FA0FF", "#3AB0B0")),
    ],
)
def test_the_simulation_confuses_known_confusable_colours(vision: str, colours: np.ndarray) -> None:
    assert least_difference(colours, VISIONS["all cones"]) > APART
    assert least_difference(colours, VISIONS[vision]) < APART
