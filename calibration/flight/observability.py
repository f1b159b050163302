"""Observability of a flight: parameters that it determines only in combination, and what to fly to separate them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration.flight.fit import FlightFit

# a combination whose variance is so small a share of what its members' would be is all that is known of them
_CONFUSED = 0.05
_MEMBER = 0.3
# a parameter whose sigma is above this share of its prior's counts as unobservable
_TAUGHT = 0.7
# the first rule whose groups are all among the members
_ADVICE: tuple[tuple[frozenset[str], str], ...] = (
    (
        frozenset({"dgps_clock", "dgps_antenna"}),
        "fly the same line both ways, or at two speeds; or measure the antenna ([target] antenna_in_body_m)",
    ),
    (frozenset({"dgps_clock", "camera_clock"}), "give one of the clocks: a camera's in [clocks], or the log's"),
    (
        frozenset({"camera_clock", "ptu_clock"}),
        "nod the head while the aircraft is in the picture, so that it crosses the picture at different speeds",
    ),
    (
        frozenset({"readout", "camera_clock"}),
        "fly fast across the picture both near its upper and its lower edge",
    ),
    (
        frozenset({"dgps_antenna"}),
        "measure the antenna from the nose with a tape; or fly both ways, and turns",
    ),
    (
        frozenset({"runway_from_base", "principal_point"}),
        "fly to all four edges of the picture, near and far; or keep the board's lens (leave lens out of --free)",
    ),
    (
        frozenset({"focal", "ptu_position"}),
        "fly near and far along the same line of sight; or survey the position; or keep the board's lens",
    ),
    (
        frozenset({"runway_from_base", "ptu_position"}),
        "fly near and far along the same line of sight, and across it; or survey the position",
    ),
    (
        frozenset({"runway_from_base", "head_from_camera"}),
        "turn the head further: pans and tilts that differ by tens of degrees; or find the boresight with mount",
    ),
    (
        frozenset({"focal", "head_from_camera"}),
        "let the aircraft leave the middle of the picture",
    ),
    (frozenset({"principal_point"}), "fly to all four edges of the picture; or keep the board's lens"),
    (frozenset({"distortion"}), "fly into the corners of the picture; or keep the board's lens"),
    (frozenset({"focal"}), "fly across the whole width of the picture; or keep the board's lens"),
    (frozenset({"drift"}), "fly for longer, or twice with half an hour between"),
    (frozenset({"camera_clock"}), "fly across the view, fast, in both directions"),
    (frozenset({"ptu_clock"}), "turn the head fast, to and fro, while the aircraft is in its picture"),
    (
        frozenset({"runway_from_base"}),
        "leave the straight line: weave from side to side and climb by a few degrees as seen from the stations",
    ),
    (frozenset({"ptu_position"}), "fly near the stations and across; or survey the position"),
)
_OTHERWISE = "fly a weave that climbs and descends, near and far, and back"


@dataclass(frozen=True, slots=True, kw_only=True)
class CorrelatedParameters:
    """Parameters that the flight determines only in combination: an eigenvector of the correlation matrix.

    Attributes
    ----------
    members : their names, largest first; ``signs`` +1 or -1 of each.
    share : the combination's variance over that without correlation.
    advice : flight or measurement that would separate them.
    """

    members: tuple[str, ...]
    signs: tuple[int, ...]
    share: float
    advice: str

    @property
    def words(self) -> str:
        """The members, and how they go together."""
        if len(self.members) == 1:
            return self.members[0]
        # the combination is well known: along the unknown direction, equal signs there are opposite
        together = "together" if self.signs[0] != self.signs[1] else "against each other"
        names = ", ".join(self.members[:-1]) + " and " + self.members[-1]
        return f"{names} (may be wrong {together})" if len(self.members) == 2 else names


def correlated_parameters(fit: FlightFit) -> list[CorrelatedParameters]:
    """Return combinations that the flight cannot take apart, the worst first; each parameter is named once or twice."""
    values, vectors = np.linalg.eigh(fit.correlation)
    found: list[CorrelatedParameters] = []
    named: set[str] = set()
    for value, vector in zip(values, vectors.T, strict=True):
        if value > _CONFUSED:
            break
        order = [int(k) for k in np.argsort(-np.abs(vector)) if abs(vector[k]) > _MEMBER * np.abs(vector).max()]
        names = tuple(fit.problem.names[k] for k in order)
        if len(names) < 2 or named.issuperset(names):
            continue
        named.update(names)
        found.append(
            CorrelatedParameters(
                members=names,
                signs=tuple(int(np.sign(vector[k])) for k in order),
                share=float(max(value, 0.0)),
                advice=advice_for(names),
            )
        )
    return found


def unobservable_parameters(fit: FlightFit) -> list[str]:
    """Return the names of parameters whose sigma is hardly below its prior's."""
    prior = fit.problem.prior_sigma
    return [n for n, s, p in zip(fit.problem.names, fit.sigma, prior, strict=True) if s > _TAUGHT * p]


def advice_for(names: Sequence[str]) -> str:
    """Return the manoeuvre that makes parameters observable."""
    groups = set()
    for name in names:
        station, _, short = name.partition(".")
        group, _, part = short.partition(".")
        groups.add(station if station.startswith("dgps_") else "drift" if part == "drift" else group)
    return next((text for wanted, text in _ADVICE if wanted <= groups), _OTHERWISE)
