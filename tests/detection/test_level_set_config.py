"""Bounds of the level set's tuning: the bounds themselves are allowed."""

import pytest

from groundstation.detection.config import LevelSetConfig


def test_the_ends_of_a_range_are_included_and_values_beyond_refused() -> None:
    for sigma_px in (0.5, 100.0):
        assert LevelSetConfig(local_sigma_px=sigma_px).local_sigma_px == sigma_px
    for share in (0.0, 1.0):
        assert LevelSetConfig(local_share=share).local_share == share
    for wrong in ({"local_sigma_px": 0.4}, {"local_sigma_px": 100.1}, {"local_share": -0.1}, {"local_share": 1.1}):
        with pytest.raises(ValueError, match="local_share must lie in"):
            LevelSetConfig(**wrong)
