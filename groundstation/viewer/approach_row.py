"""What is known of an approach at one time, for Rerun's channel and the live view; does not import Rerun."""

from dataclasses import dataclass

from groundstation.integrity.approach_advice import ApproachAdvice
from groundstation.landing.glide_path import ApproachDeviations
from groundstation.landing.touchdown import TouchdownForecast


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ApproachRow:
    """What is known of an approach at one session time, s; None where there is none.

    Attributes
    ----------
    t_s : session time.
    advice, deviations, touchdown : as the integrity monitor and the landing monitor have them.
    """

    t_s: float
    advice: ApproachAdvice | None
    deviations: ApproachDeviations | None
    touchdown: TouchdownForecast | None
