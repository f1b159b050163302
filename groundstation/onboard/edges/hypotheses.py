"""Hypotheses of the runway: pairs of lines tracked in parallel until one of them is confirmed.

A taxiway next to a runway, a road, a repaired strip: in one picture two of their edges can have the contrast of
the runway's. Over some frames they differ: on the ground they are too wide or too far aside once roll, pitch and
height are estimated from the lines' intersection, they move against the pose, or the area between them has different
colours at its two edges.
"""

import math
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.onboard.edges.config import MeasurementModel, TrackerConfig
from groundstation.onboard.edges.detection import NoPair, detect
from groundstation.onboard.edges.edge_measurement import EdgeMeasurement
from groundstation.onboard.edges.frame_geometry import (
    TrackerCamera,
    edge_noise,
    geometry_between_rows,
    other_pair_noise,
    pose_noise,
    widths_of,
    yaw_place_m,
)
from groundstation.onboard.edges.gradient_descent import descend
from groundstation.onboard.edges.kalman import LineState, update_crossings
from groundstation.onboard.edges.line_state import C, D
from groundstation.onboard.edges.line_tracking import TrackingStep, marks_of, plain_edges, profiled, track_lines
from groundstation.onboard.edges.lines import angle_between, line_map, project_lines, state_from_crossings
from groundstation.onboard.edges.marking_removal import remove_markings
from groundstation.onboard.edges.markings import Markings
from groundstation.onboard.edges.pose import NoseCameraPose
from groundstation.onboard.edges.report import EdgeMiss, Edges
from groundstation.onboard.edges.runway_plausibility import pair_weight
from groundstation.onboard.edges.search_band import NoBand, across_direction, band_rows
from groundstation.onboard.edges.strip import find_edges, refine_edges, search_edges

# sigma of a detected pair's crossings
_FIRST_SIGMA_PX = 3.0
# what an announced runway's edges may each be off by, for its width and for the pose's place
_ANNOUNCED_M = 3.0
# pairs of a picture that are measured, those of the lowest energies
_FIRST_PAIRS, _MORE_PAIRS = 4, 2
_MOST_NIS = 25.0
# of a pair that was not measured yet: as expected of four crossings
EXPECTED_NIS = 4.0
# sigma of c and d of a pair that was only detected, m
_ANYWHERE_M = 10.0
# weights of a score: agreement of the edges' colours, misfit to the pose, frames without edges
_AGREEMENT, _NIS, _MISSED = 4.0, 0.125, 4.0
# frames over which these are means, and over which contrast is
_MEMORY, _CONTRAST_MEMORY = 12, 5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Hypothesis:
    """A pair that may be the runway.

    Attributes
    ----------
    state, edges : the lines, and their measurement in the last frame.
    frames, missed : since the pair was found; without edges since the last measurement.
    agreement, nis, lost : means over the last frames: see `EdgeMeasurement`, NIS at most 25, share without edges.
    markings : paint and lamps next to its edges, if it was tracked by profiles.
    contrast : (2,) mean over the last frames across both edges, 0 to 1; None before the first.
    found : what the last frame's picture showed; None where nothing was measured or accepted, and at the start.
    yaw_place_m : by how much the poses' lasting error of yaw moved it across the runway in the last frame, sigma.
    """

    state: LineState
    edges: Edges | None
    frames: int
    missed: int
    agreement: float
    nis: float
    lost: float
    markings: Markings | None = None
    contrast: FloatArray | None = None
    found: EdgeMeasurement | None = None
    yaw_place_m: float = 0.0

    def after(self, step: TrackingStep) -> "Hypothesis":
        """Return the hypothesis after a step."""
        weight = 1.0 / min(self.frames + 1, _MEMORY)
        seen = step.found is not None
        agreement, nis, contrast = self.agreement, self.nis, self.contrast
        if step.found is not None and step.edges is not None:
            agreement += weight * (step.found.agreement - agreement)
            nis += weight * (min(step.edges.nis, _MOST_NIS) - nis)
            before = step.found.contrast if contrast is None else contrast
            contrast = before + (step.found.contrast - before) / _CONTRAST_MEMORY
        return Hypothesis(
            state=step.state,
            edges=step.edges,
            frames=self.frames + 1,
            missed=0 if seen else self.missed + 1,
            agreement=agreement,
            nis=nis,
            lost=self.lost + weight * (float(not seen) - self.lost),
            markings=step.found.markings
            if step.found is not None and step.found.markings is not None
            else self.markings,
            contrast=contrast,
            found=step.found,
            yaw_place_m=step.yaw_place_m,
        )


def score(hypothesis: Hypothesis, config: TrackerConfig) -> float:
    """Return how well a pair does: logarithms, as of likelihoods; the higher the better."""
    mean = hypothesis.state.mean
    place = 0.5 * float(mean[C] + mean[D]) / math.hypot(config.start_shift_m, hypothesis.yaw_place_m)
    width = math.log(max(abs(float(mean[C] - mean[D])), 0.1) / config.guess.width_m) / math.log(config.start_width)
    turn = angle_between(mean) / config.start_turn_rad
    ground = -math.log1p(place**2) - math.log1p(width**2) - 0.5 * turn**2
    return ground + _AGREEMENT * hypothesis.agreement - _NIS * hypothesis.nis - _MISSED * hypothesis.lost


@dataclass(slots=True, kw_only=True, eq=False)
class PairSearch:
    """Algorithm 1 on one picture, and its pairs that are still to be measured.

    A measurement takes as long as tracking a pair for a frame, so a tracker with a runway takes one per frame.

    Attributes
    ----------
    painted, image : the picture (h, w, 3), and without its paint.
    pose, rows, e : its geometry.
    middle : crossings (4,) of the announced runway.
    known : the pairs that were tracked when the picture was taken.
    waiting : crossings (4,) of the pairs to measure, the announced runway first.
    found : measurements of pairs that were not known.
    miss : reason of the miss if none is found.
    """

    painted: ImageArray
    image: ImageArray
    pose: NoseCameraPose
    rows: FloatArray
    e: FloatArray
    middle: FloatArray
    known: list[Hypothesis]
    waiting: list[FloatArray]
    found: list[Hypothesis]
    miss: EdgeMiss


def find_pairs(camera: TrackerCamera, image: ImageArray, pose: NoseCameraPose) -> list[Hypothesis] | EdgeMiss:
    """Run Algorithm 1, and return measurements of its best pairs; or the reason of the miss."""
    search = begin_search(camera, image, pose, [])
    continue_search(camera, search, len(search.waiting))
    return search.found or search.miss


def begin_search(camera: TrackerCamera, image: ImageArray, pose: NoseCameraPose, known: list[Hypothesis]) -> PairSearch:
    """Run Algorithm 1; its pairs, and the announced runway, are queued for measurement in this picture, which is kept.

    Pairs that are ``known`` already are left out, and fewer are measured where there are some.
    """
    config, kappa = camera.config, camera.kappa
    e, middle = line_map(pose, kappa), np.zeros(4)
    search = PairSearch(
        painted=image,
        image=image,
        pose=pose,
        rows=np.zeros(2),
        e=e,
        middle=middle,
        known=known,
        waiting=[],
        found=[],
        miss=EdgeMiss.NONE,
    )
    rows = band_rows(pose, kappa, camera.image_size_px, config.guess)
    if isinstance(rows, NoBand):
        search.miss = EdgeMiss.NO_BAND
        return search
    half = 0.5 * config.guess.width_m
    search.rows, search.middle = rows, project_lines(np.array([1.0, 0.0, -half, half]), e, rows)[0]
    px_per_m = np.abs(search.middle[2:] - search.middle[:2]) / (2.0 * half)
    # a picture for later measurement is copied, because the caller may overwrite it with the next one
    search.painted = image.copy()
    search.image = remove_markings(search.painted, rows, config.paint_m * float(px_per_m[1]))
    pairs = detect(search.image, rows, px_per_m, config.detection, lambda x: pair_weight(x, rows, pose, kappa, config))
    wanted = (_MORE_PAIRS if known else _FIRST_PAIRS) if config.confirm_frames > 1 else 1
    if config.use_strip and config.confirm_frames > 1:
        search.waiting.append(search.middle)
    if not isinstance(pairs, NoPair):
        search.waiting += [crossings for crossings in pairs.pairs_px[:wanted] if not _known(search, crossings)]
    search.miss = EdgeMiss.NO_PAIR if isinstance(pairs, NoPair) else EdgeMiss.FAINT
    return search


def continue_search(camera: TrackerCamera, search: PairSearch, most: int) -> None:
    """Measure this number of queued pairs, if there are as many, and keep the results."""
    for _ in range(min(most, len(search.waiting))):
        crossings = search.waiting.pop(0)
        if crossings is search.middle:
            near = _announced(camera, search.image, search.rows, search.pose)
            near = None if near is not None and _known(search, near.crossings_px) else near
        else:
            near = _first_look(camera, search.image, crossings, search.rows, search.pose, search.e)
        if near is not None:
            # a picture's first pairs are reported, and are worth a profile
            painted = None if search.known else search.painted
            search.found.append(_started(camera, painted, near, crossings, search.rows, search.pose))


def _known(search: PairSearch, crossings_px: FloatArray) -> bool:
    """Return whether crossings (4,) in a search's picture are those of a pair that was followed there."""
    return any(one.edges is not None and one.edges.are_lines(crossings_px, search.rows) for one in search.known)


def track_hypotheses(
    camera: TrackerCamera, image: ImageArray, pose: NoseCameraPose, old: list[Hypothesis], new: list[Hypothesis]
) -> list[Hypothesis]:
    """Return every pair one frame later, without those that were not seen for long, and without doubles.

    ``old`` with the best first; ``new`` were seen in a picture before this one and have not been followed yet.
    """
    # one of several is dropped sooner than the runway
    profile, most = camera.config.profile, camera.config.coast_frames // 2
    # the report is the best one's, for which alone there is time for profiles
    best, layouts = (None, 0) if profile is None else (old[0], profile.layouts_beside)
    moved = [
        [
            h.after(track_lines(camera, image, pose, h.state, thorough=h is best, markings=h.markings, layouts=layouts))
            for h in hypotheses
        ]
        for hypotheses in (old, new)
    ]
    return merge_hypotheses(camera, *([h for h in hypotheses if h.missed <= most] for hypotheses in moved))


def merge_hypotheses(camera: TrackerCamera, old: list[Hypothesis], new: list[Hypothesis]) -> list[Hypothesis]:
    """Return the best of both lists, at most as many as configured, the best first; of two equal ones the earlier."""
    config, kept = camera.config, list[Hypothesis]()
    for one in sorted(old, key=lambda h: -score(h, config)) + new:
        if not any(same_lines(one, other) for other in kept):
            kept.append(one)
    return sorted(kept, key=lambda h: -score(h, config))[: config.hypotheses]


def same_lines(one: Hypothesis, other: Hypothesis) -> bool:
    """Return whether two pairs are the same lines of the picture."""
    if one.edges is None or other.edges is None:
        return False
    return other.edges.are_lines(one.edges.crossings_px, one.edges.rows_px)


def _announced(
    camera: TrackerCamera, image: ImageArray, rows: FloatArray, pose: NoseCameraPose
) -> EdgeMeasurement | None:
    """Return the measurement about the announced runway's position by the pose, within the errors of both."""
    config = camera.config
    half = 0.5 * config.guess.width_m
    state = _prior(config, np.array([1.0, 0.0, -half, half]))
    state.covariance[C, C] = state.covariance[D, D] = _ANNOUNCED_M**2
    look = geometry_between_rows(camera, pose, state, rows)
    prior = look.h @ state.covariance @ look.h.T + pose_noise(config, look)
    widths = widths_of(config, state.mean[:4], look.e, rows, look.predicted, config.band_m)
    wide = search_edges(image, look.predicted, rows, widths, look.across, prior, config.strip)
    if wide is None:
        return None
    down = descend(image, wide, rows, widths, config.descent, look.across)
    return refine_edges(image, down.crossings_px, rows, widths, look.across, config.strip)


def _first_look(
    camera: TrackerCamera,
    image: ImageArray,
    crossings: FloatArray,
    rows: FloatArray,
    pose: NoseCameraPose,
    e: FloatArray,
) -> EdgeMeasurement | None:
    """Return a detected pair, made better by what follows it in every other frame."""
    config = camera.config
    mean = state_from_crossings(crossings, rows, pose, camera.kappa)
    if not np.isfinite(mean).all():
        return None
    widths = widths_of(config, mean, e, rows, project_lines(mean, e, rows)[0], config.first_band_m)
    prior, across = _FIRST_SIGMA_PX**2 * np.eye(4), across_direction(e)
    if config.use_strip:
        wide = find_edges(image, crossings, rows, widths, across, prior, config.strip)
        if wide is None:
            return None
        crossings = wide.crossings_px
    down = descend(image, crossings, rows, widths, config.descent, across if config.bands_across else None)
    if not config.use_strip:
        return plain_edges(down.crossings_px)
    return refine_edges(image, down.crossings_px, rows, widths, across, config.strip)


def _started(
    camera: TrackerCamera,
    painted: ImageArray | None,
    found: EdgeMeasurement,
    detected: FloatArray,
    rows: FloatArray,
    pose: NoseCameraPose,
) -> Hypothesis:
    """Return the filter's start: next to nothing known of the lines, and the pose's errors as configured.

    With a picture that has its paint, the edges are those of the profiles.
    """
    config = camera.config
    state = _prior(config, state_from_crossings(found.crossings_px, rows, pose, camera.kappa))
    look = geometry_between_rows(camera, pose, state, rows)
    if config.profile is not None and painted is not None:
        prior = _FIRST_SIGMA_PX**2 * np.eye(4)
        found = profiled(config.profile, painted, look, state, found.crossings_px, prior, None, layouts=0)
        state = _prior(config, state_from_crossings(found.crossings_px, rows, pose, camera.kappa))
        look = geometry_between_rows(camera, pose, state, rows)
    noise = found.covariance_px2 + pose_noise(config, look)
    update = update_crossings(state, look.predicted, look.h, found.crossings_px, noise)
    lasting = edge_noise(config, found.crossings_px, rows, update.state.mean, found)
    if config.measurement is MeasurementModel.CROSSINGS:
        lasting += other_pair_noise(config, look, update.state)
    edges = Edges(
        state=update.state,
        rows_px=rows,
        crossings_px=found.crossings_px,
        covariance_px2=found.covariance_px2 + lasting,
        systematic_px2=lasting,
        predicted_px=detected,
        measured_px=found.crossings_px,
        nis=math.nan,
        marks=marks_of(config, found),
    )
    return Hypothesis(
        state=update.state,
        edges=edges,
        frames=1,
        missed=0,
        agreement=found.agreement,
        nis=EXPECTED_NIS,
        lost=0.0,
        markings=found.markings,
        yaw_place_m=yaw_place_m(config, pose),
    )


def _prior(config: TrackerConfig, mean: FloatArray) -> LineState:
    """Return lines (4,) of which next to nothing is known, with the pose's errors as configured."""
    prior = np.diag(
        [0.0, 0.0, *[_ANYWHERE_M**2] * 2, *[config.lasting_attitude_rad**2] * 2, config.lasting_height_m**2]
    )
    prior[:2, :2] = config.start_turn_rad**2 * np.outer([-mean[1], mean[0]], [-mean[1], mean[0]])
    if config.measurement is MeasurementModel.LINES:
        return LineState(mean=mean, covariance=prior[:4, :4])
    return LineState(mean=np.concatenate([mean, np.zeros(3)]), covariance=prior)
