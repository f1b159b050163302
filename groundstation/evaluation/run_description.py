"""Interface of the evaluation to sessions and runners: description of a run."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from groundstation.arrays import FloatArray
from groundstation.evaluation.metrics import PhaseLike
from groundstation.messages import CarriedError


class TruthLike(Protocol):
    """Exact positions of the target point: ``t_s`` (n,) session clock, ``position_runway_m`` (n, 3)."""

    @property
    def t_s(self) -> FloatArray:
        """Return the times (n,)."""

    @property
    def position_runway_m(self) -> FloatArray:
        """Return the positions (n, 3)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunDescription:
    """Description of the session for the evaluation.

    Attributes
    ----------
    name : of the session.
    phases : stretches with one kind of background; may be empty.
    antenna_in_body_m : (3,) from the nose, x forward, y right, z down, or None if not known.
    clocks_given : the session's clock is the DGPS clock; an offset is still looked for and reported.
    acceleration_psd_m2_s3 : the filter's (x, y, z) motion model, for the posterior bound.
    configuration : the resolved configuration of the run.
    speed : figures on processing speed, by name.
    fused_late : how many readings and frames came late and were fused in their place, by kind.
    faults : what could not be used (a broken reference file, a video cut short), one line each.
    contradictions : inputs that cannot be right, one line each.
    place : the frame, its origin on Earth and the stations, as `summary.json` keeps them; empty if not known.
    provenance : date, program, command, inputs with hashes, machine; empty if not known.
    carried_errors : the filter's final estimates of the errors of calibration and clocks.
    learnt_until_s : up to this time of the DGPS clock the filter used the DGPS; None if never.
    """

    name: str
    phases: Sequence[PhaseLike] = ()
    antenna_in_body_m: FloatArray | None = None
    clocks_given: bool = False
    acceleration_psd_m2_s3: tuple[float, float, float] = (0.3, 0.6, 0.3)
    configuration: Mapping[str, Any] | None = None
    speed: Mapping[str, float] | None = None
    fused_late: Mapping[str, int] | None = None
    faults: tuple[str, ...] = ()
    contradictions: tuple[str, ...] = ()
    place: Mapping[str, Any] = field(default_factory=dict)
    provenance: Mapping[str, Any] = field(default_factory=dict)
    carried_errors: tuple[CarriedError, ...] = ()
    learnt_until_s: float | None = None
