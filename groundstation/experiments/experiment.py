"""An experiment and its findings: tables, figures, and the differences of its set-up from the paper's."""

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

from groundstation.experiments.tables import ResultTable
from groundstation.experiments.truth_session import TruthSession


class Paper(StrEnum):
    """Which paper: the ground system, or one of the two systems on the aircraft's own camera."""

    GROUND = "ground stereo, Chan-Vese and EKF"
    EDGES = "runway detection and tracking"
    POSE = "runway pose by dual quaternion"


@dataclass(frozen=True, slots=True, kw_only=True)
class PaperFigure:
    """One figure: ``name`` of its file, ``title`` with the paper's number, ``caption``, and ``draw`` to a PNG file."""

    name: str
    title: str
    caption: str
    draw: Callable[[Path], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Findings:
    """What an experiment found; ``differences`` name in what its set-up is not the paper's."""

    tables: tuple[ResultTable, ...]
    figures: tuple[PaperFigure, ...] = ()
    differences: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Experiment:
    """One experiment of a paper.

    Attributes
    ----------
    name : for ``--only``; lower case, words joined by hyphens.
    paper, numbers : its place there, such as "figure 10, table 1".
    title : its subject.
    run : runs it; results that several experiments share are computed once.
    """

    name: str
    paper: Paper
    numbers: str
    title: str
    run: Callable[[TruthSession], Findings] = field(repr=False)
