"""The rules in the order of their use: where to look, what a window shows, which track is followed."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from groundstation.detection import learned_detector, learned_finder, nose_hypotheses
from groundstation.detection.candidate_finder import CandidateFinder
from groundstation.detection.channel_window import TARGET_PX
from groundstation.detection.learned_detector import LearnedDetector
from groundstation.detection.learned_finder import LearnedFinder
from groundstation.estimation import initialise
from groundstation.estimation.earlier_pixels import EarlierPixels
from groundstation.estimation.guided_search import GuidedSearch
from groundstation.estimation.initialise import TrackInitiator
from groundstation.estimation.station_ekf import StationEkf
from groundstation.evaluation.unconfirmed_rows import UnconfirmedRows
from groundstation.messages import OutcomeKind, StepReport
from groundstation.tracking import track_confirmation, track_manager, weighed_pixel
from groundstation.tracking.alternative_track import AlternativeTrack
from groundstation.tracking.existence_probability import ExistenceProbability
from groundstation.tracking.recognition import Recognition
from groundstation.tracking.track_state_machine import TrackStateMachine
from rules.rule import Rule, always, constant, first_of


def _no_narrower_window(best: Any) -> Callable[..., Any]:
    def without(self: Any, *arguments: Any, weaker: bool = True) -> Any:
        return best(self, *arguments) if weaker else None

    return without


def _no_weaker_region(scored: Any) -> Callable[..., Any]:
    def without(self: Any, *arguments: Any, weaker: bool) -> Any:
        return scored(self, *arguments, weaker=False)

    return without


def _no_withdrawal(take: Any) -> Callable[..., Any]:
    def without(self: Any, report: StepReport, rows: Any) -> Any:
        kept = {OutcomeKind.DISPLACED: OutcomeKind.DROPPED}
        outcomes = tuple(replace(each, kind=kept.get(each.kind, each.kind)) for each in report.outcomes)
        return take(self, replace(report, outcomes=outcomes), rows)

    return without


def _hits_alone(miss: Any) -> Callable[..., Any]:
    return lambda self, station, t_s, in_view: miss(self, station, t_s, 0.0)


RULES = (
    Rule(
        name="places kept from the frame before",
        where=learned_finder,
        attribute="kept_places",
        without=always([]),
    ),
    Rule(
        name="proposals by contrast and motion",
        where=CandidateFinder,
        attribute="find",
        without=always(()),
    ),
    Rule(name="proposal network", where=LearnedFinder, attribute="_proposed", without=always([])),
    Rule(
        name="search guided by the other camera",
        where=GuidedSearch,
        attribute="places",
        without=always([]),
    ),
    Rule(name="grid", where=LearnedFinder, attribute="_turn_of_grid", without=always(())),
    Rule(
        name="window for half the width",
        where=LearnedDetector,
        attribute="_best",
        without=_no_narrower_window,
    ),
    Rule(
        name="weaker regions where the target is expected",
        where=LearnedDetector,
        attribute="_scored",
        without=_no_weaker_region,
    ),
    Rule(
        name="finer window once the direction is known",
        where=learned_detector,
        attribute="_FINEST_TARGET_PX",
        without=constant(TARGET_PX),
    ),
    Rule(
        name="several windows for a vague prediction",
        where=learned_detector,
        attribute="_MOST_WINDOWS",
        without=constant(1),
    ),
    Rule(
        name="window at the border",
        where=learned_detector,
        attribute="_inside",
        without=first_of,
    ),
    Rule(
        name="two hypotheses on the nose",
        where=LearnedDetector,
        attribute="_hypotheses",
        without=always(()),
    ),
    Rule(
        name="their weight by the prediction",
        where=weighed_pixel,
        attribute="_MOST_LOG_ODDS",
        without=constant(0.0),
    ),
    Rule(
        name="a nose outside of the silhouette is less likely",
        where=nose_hypotheses,
        attribute="_OUTSIDE",
        without=constant(1.0),
    ),
    Rule(
        name="of two fixes at a place the likelier",
        where=initialise,
        attribute="without_lesser",
        without=first_of,
    ),
    Rule(
        name="no narrow pair with a part of an aircraft",
        where=initialise,
        attribute="without_false_pairs",
        without=first_of,
    ),
    Rule(
        name="of two tracks in a state the better",
        where=initialise,
        attribute="without_copies",
        without=first_of,
    ),
    Rule(
        name="link to the likelier fix",
        where=initialise,
        attribute="_LINK_ODDS",
        without=constant(0.0),
    ),
    Rule(
        name="start without motion if recognised",
        where=TrackInitiator,
        attribute="_is_recognised",
        without=always(False),
    ),
    Rule(
        name="pixels before the start",
        where=EarlierPixels,
        attribute="of",
        without=always(()),
    ),
    Rule(
        name="reported only once it moves by 5 sigma",
        where=track_confirmation,
        attribute="_FLYING_GATE",
        without=constant(0.0),
    ),
    Rule(
        name="what crosses on the ground is not reported",
        where=track_confirmation,
        attribute="_crosses_on_ground",
        without=always(False),
    ),
    Rule(
        name="none yields to a far less likely one",
        where=Recognition,
        attribute="is_likelier_than",
        without=always(False),
    ),
    Rule(
        name="yields to a far nearer one",
        where=track_manager,
        attribute="_FAR_NEARER",
        without=constant(0.0),
    ),
    Rule(
        name="any yielding to another target",
        where=TrackStateMachine,
        attribute="yields_to",
        without=always(False),
    ),
    Rule(
        name="a missed target is followed where it is found",
        where=track_manager.TrackManager,
        attribute="_fits_prediction",
        without=always(False),
    ),
    Rule(
        name="restart where cameras agree",
        where=AlternativeTrack,
        attribute="step",
        without=always(None),
    ),
    Rule(
        name="misses lower the existence",
        where=ExistenceProbability,
        attribute="miss",
        without=_hits_alone,
    ),
    Rule(
        name="misses move the estimate",
        where=StationEkf,
        attribute="update_miss",
        without=always(None),
    ),
    Rule(
        name="widths update range and span",
        where=StationEkf,
        attribute="update_width",
        without=always(None),
    ),
    Rule(
        name="pixels of a displaced track are withdrawn",
        where=UnconfirmedRows,
        attribute="take",
        without=_no_withdrawal,
    ),
)
