"""Composites over two small clips: deterministic, true where the picture changes, clear of the real aircraft."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from groundstation.bank.composites.composite_row import composite_row, row_of
from groundstation.bank.composites.composite_sight import CLEAR_PX
from groundstation.bank.composites.composite_spec import CompositeSpec
from groundstation.bank.composites.draw_composite import LEAST_FRAMES, draw_composite
from groundstation.bank.composites.layered_picture import BLOCK_PX
from groundstation.bank.composites.render_composite import CompositeFrame, render_composite, silhouette_box
from groundstation.bank.composites.segment_view import CompositeClips, SegmentFootage
from groundstation.box import expand, overlap
from groundstation.errors import ScenarioError
from groundstation.simulation.world.draw_world import WITHHELD_FAMILIES
from groundstation.simulation.world.world_sets import WorldSet, seed_of, set_of
from tests.bank.composites.made_clips import FRAMES, PAN_PX, SKYLINE_ROW, write_clips

SEED = 3


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_clips(tmp_path_factory.mktemp("clips"))


@pytest.fixture(scope="module")
def clips(folder: Path) -> CompositeClips:
    return CompositeClips(folder)


@pytest.fixture(scope="module")
def spec(clips: CompositeClips) -> CompositeSpec:
    return draw_composite(SEED, clips)


@pytest.fixture(scope="module")
def footage(clips: CompositeClips, spec: CompositeSpec) -> SegmentFootage:
    return clips.footage(WorldSet.TRAIN, spec.clip, spec.first)


@pytest.fixture(scope="module")
def frames(spec: CompositeSpec, footage: SegmentFootage) -> list[CompositeFrame]:
    return list(render_composite(spec, footage))


def test_the_same_seed_gives_the_same_frames_to_the_last_bit(
    folder: Path, spec: CompositeSpec, frames: list[CompositeFrame]
) -> None:
    clips = CompositeClips(folder)
    again = draw_composite(SEED, clips)
    assert again == spec
    assert draw_composite(SEED + 1, clips) != spec
    rendered = list(render_composite(again, clips.footage(set_of(SEED), again.clip, again.first)))
    assert len(rendered) == len(frames) >= LEAST_FRAMES
    for one, other in zip(frames, rendered, strict=True):
        assert one.image.tobytes() == other.image.tobytes()
        assert (one.snr, one.width_px, one.unhidden) == (other.snr, other.width_px, other.unhidden)


def test_the_picture_changes_where_the_silhouette_is_and_nowhere_else(
    spec: CompositeSpec, footage: SegmentFootage, frames: list[CompositeFrame]
) -> None:
    """Expected: without birds, what differs from the clip is in the coder's blocks that silhouette and blur touch."""
    alone = frames if not spec.birds else list(render_composite(replace(spec, birds=()), footage))
    for frame in alone[::8]:
        clip = footage.frames[frame.index - footage.segment.first].astype(int)
        change = np.abs(frame.image.astype(int) - clip).max(axis=2)
        assert frame.silhouette is not None
        mask = np.zeros(change.shape, np.uint8)
        box = silhouette_box(frame.silhouette)
        mask[box.slices] = frame.silhouette.mask
        # three sigmas of blur, and what the smear of the exposure adds
        rim = 2 * (3 + int(np.ceil(3.0 * footage.view.blur_px))) + 1
        near = cv2.dilate(mask, np.ones((rim, rim), np.uint8)) > 0
        rows, columns = (n // BLOCK_PX for n in near.shape)
        blocks = near.reshape(rows, BLOCK_PX, columns, BLOCK_PX).any(axis=(1, 3))
        assert not change[~np.kron(blocks, np.ones((BLOCK_PX, BLOCK_PX), dtype=bool))].any()
        assert (change[mask > 0] > 0).mean() > 0.8
        assert change[mask > 0].mean() > 8.0 * change[~near & (change > 0)].mean()
        assert frame.nose_px is not None
        assert frame.width_px > 0.0
        assert frame.snr > 0.0


def test_the_drawn_aircraft_keeps_away_from_the_real_one(frames: list[CompositeFrame]) -> None:
    for frame in frames:
        assert frame.silhouette is not None
        assert frame.real_aircraft is not None
        own = silhouette_box(frame.silhouette)
        assert not overlap(expand(frame.real_aircraft, CLEAR_PX - 1.0), type(frame.real_aircraft)(*map(float, own)))


def test_no_frame_is_drawn_over_a_clip_of_another_set(clips: CompositeClips, spec: CompositeSpec) -> None:
    validate = seed_of(WorldSet.VALIDATE, SEED)
    drawn = draw_composite(validate, clips)
    assert (spec.clip, drawn.clip) == ("V_AIRPLANE_001", "V_AIRPLANE_021")
    assert not {spec.airframe.family, drawn.airframe.family} & set(WITHHELD_FAMILIES)
    for wrong, clip in ((spec, drawn.clip), (drawn, spec.clip)):
        with pytest.raises(ScenarioError, match=r"got a clip of (train|validate); wanted a clip of (train|validate)"):
            replace(wrong, clip=clip)
    with pytest.raises(ScenarioError, match="got a clip of train; wanted a clip of validate"):
        render_composite(drawn, clips.footage(WorldSet.TRAIN, spec.clip, spec.first))
    with pytest.raises(ScenarioError, match="got a clip of no set"):
        replace(spec, clip="V_AIRPLANE_033")


def test_the_camera_of_a_clip_follows_its_pan_and_horizon(footage: SegmentFootage, spec: CompositeSpec) -> None:
    shift = footage.view.shifts_px[-1]
    # small copies show a step of half a pixel to some hundredths
    assert shift == pytest.approx([-PAN_PX * (FRAMES - 1), 0.0], abs=0.08 * FRAMES)
    assert footage.view.horizon_row == pytest.approx(SKYLINE_ROW, abs=9.0)
    heads = spec.camera.heads(footage.view.shifts_px)
    # the scene moves left in the picture when the camera turns right, and pan is positive to the left
    assert heads[-1].pan_rad == pytest.approx(np.arctan(shift[0] / spec.camera.focal_px))
    assert heads[-1].pan_rad < 0.0


def test_a_row_counts_hits_and_wrong_points_over_visible_frames(
    clips: CompositeClips, frames: list[CompositeFrame]
) -> None:
    row = composite_row(SEED, clips)
    visible = sum(frame.visible for frame in frames)
    assert row["visible_frames"] == visible > 0
    assert 0 <= row["hit"] + row["wrong"] <= visible
    assert row["hit_share"] == pytest.approx(row["hit"] / visible)
    assert row["hit_share"] > 0.5


def test_a_composite_without_a_visible_frame_has_no_shares(spec: CompositeSpec) -> None:
    row = row_of(spec, [])
    assert (row["visible_frames"], row["hit_share"], row["wrong_share"]) == (0, None, None)
    assert row["size"] == row["background"] == "none"
