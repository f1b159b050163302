"""Sizes of a runway's markings."""

from dataclasses import dataclass

from groundstation.simulation.parameter_checks import require, require_finite, require_within


@dataclass(frozen=True, slots=True, kw_only=True)
class RunwayPaint:
    """Lines and blocks on a runway; the defaults are the standard site's, those of a runway for model aircraft.

    Attributes
    ----------
    edge_width_m : width of the lines along the edges, and their distance from them.
    dash_length_m, dash_every_m, dash_width_m : of the centre line's dashes, from one's beginning to the next.
    dash_from_y_m : where a dash begins.
    aim_length_m : of the blocks at the aim mark.
    """

    edge_width_m: float = 0.18
    dash_length_m: float = 6.0
    dash_every_m: float = 14.0
    dash_width_m: float = 0.2
    dash_from_y_m: float = 0.0
    aim_length_m: float = 9.0

    def __post_init__(self) -> None:
        require_within(
            self,
            {
                "edge_width_m": (0.02, 5.0),
                "dash_length_m": (0.1, 200.0),
                "dash_every_m": (0.1, 500.0),
                "dash_width_m": (0.02, 5.0),
                "aim_length_m": (0.1, 100.0),
            },
        )
        require_finite("RunwayPaint: dash_from_y_m", self.dash_from_y_m)
        fits = self.dash_length_m <= self.dash_every_m
        wanted = f"at most dash_every_m = {self.dash_every_m:g}"
        require(fits, "RunwayPaint: dash_length_m", got=f"{self.dash_length_m:g}", wanted=wanted)
