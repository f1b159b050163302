"""Prior of a session's DGPS clock and antenna: from the session itself, else from the rig in use."""

from collections.abc import Sequence
from dataclasses import dataclass

from groundstation.arrays import FloatArray
from groundstation.estimation.config import EstimationConfig
from groundstation.estimation.parameters import DGPS_ANTENNA, DGPS_CLOCK, ParameterPrior
from groundstation.session import Session
from groundstation.session.antenna import AntennaSource, antenna_position


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReferencePrior:
    """Prior clock offset and antenna position of the DGPS.

    Attributes
    ----------
    offset_s : t_dgps = t_session + offset, from the rig; 0 if unknown, or if the session's clock is the log's.
    offset_sigma_s : one sigma of it, from the rig; None if the rig does not state the clock.
    antenna_in_body_m : (3,) from the nose: x forward, y right, z down; None if unknown.
    errors : prior of the parameters that a filter estimates from the log.
    notes : values taken from the rig, one line each.
    """

    offset_s: float
    offset_sigma_s: float | None
    antenna_in_body_m: FloatArray | None
    errors: ParameterPrior
    notes: tuple[str, ...]


def reference_prior(session: Session, config: EstimationConfig) -> ReferencePrior:
    """Combine session.toml with the rig's ``[reference]``; session.toml has precedence."""
    reference = session.rig.reference
    sigmas: dict[str, float] = {}
    notes: list[str] = []
    offset_s, known_sigma_s = 0.0, None
    if not session.has_clocks:
        sigma_s = config.reference_clock_sigma_s
        known = None if reference is None else reference.clock_for(session.clock_identity)
        if reference is not None and known is not None:
            offset_s, sigma_s = known, reference.offset_sigma_s
            known_sigma_s = sigma_s
            notes.append(f"DGPS clock by the rig: {offset_s:+.3f} s ± {1e3 * sigma_s:.1f} ms to begin with")
        elif reference is not None and reference.offset_s is not None and session.in_operation:
            notes.append(
                f"DGPS clock by the rig: not used, {reference.offset_s:+.3f} s is of session {reference.session!r},"
                " and an operation refers its receiver to UTC at each start"
            )
        sigmas[f"{DGPS_CLOCK}.offset"] = sigma_s
    antenna = antenna_position(session)
    if antenna.source is not AntennaSource.SESSION:
        spread: Sequence[float] = config.reference_antenna_sigma_m
        if antenna.source is AntennaSource.RIG:
            notes.append(f"DGPS antenna by the rig: {antenna.words}")
        if antenna.sigma_m is not None:
            spread = [float(v) for v in antenna.sigma_m]
        sigmas.update(zip(DGPS_ANTENNA, spread, strict=True))
    return ReferencePrior(
        offset_s=offset_s,
        offset_sigma_s=known_sigma_s,
        antenna_in_body_m=antenna.in_body_m,
        errors=ParameterPrior.independent(list(sigmas), list(sigmas.values())),
        notes=tuple(notes),
    )
