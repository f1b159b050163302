"""docs/conventions.md matches the code: its numbers and words are compared with it."""

from pathlib import Path

import pytest

from groundstation.estimation.config import EstimationConfig
from groundstation.geometry.camera import FOLD_MARGIN, LENS_REACH
from groundstation.messages import MissReason, TrackStatus
from groundstation.tracking.synchronise import SynchroniseConfig

PAGE = (Path(__file__).resolve().parent.parent / "docs" / "conventions.md").read_text(encoding="utf-8")


def test_numbers_on_the_page() -> None:
    assert f"`synchronise.hold_s` ({SynchroniseConfig().hold_s:g} s)" in PAGE
    assert f"`synchronise.max_gap_s` ({SynchroniseConfig().max_gap_s:g} s)" in PAGE
    assert f"more than {EstimationConfig().encoder_gate_sigma:g} σ off" in PAGE
    assert f"Beyond {LENS_REACH:g} corner radii, or {FOLD_MARGIN:g} of the radius" in PAGE
    assert f"{EstimationConfig().lost_after_s:g} s have passed without an accepted pixel" in PAGE
    assert f"`estimation.coast_after_s` ({EstimationConfig().coast_after_s:g} s)" in PAGE


@pytest.mark.parametrize("word", list(TrackStatus))
def test_every_status_is_explained(word: TrackStatus) -> None:
    assert f"`{word.value}` " in PAGE


@pytest.mark.parametrize("reason", [MissReason.NO_PTU_ANGLE, MissReason.LATE])
def test_reasons_named_in_the_rules_exist(reason: MissReason) -> None:
    assert f"`{reason.value}`" in PAGE


def test_counters_named_in_the_rules_exist() -> None:
    from groundstation.tracking.config import Config
    from groundstation.tracking.pipeline import Pipeline
    from tests.stereo_rig import make_rig

    counts = Pipeline(make_rig(), Config()).counts
    assert "late_ptu" in counts
    assert "(`late_ptu`)" in PAGE
