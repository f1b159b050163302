"""Where the DGPS antenna is on the aircraft: by the session, else by the rig in use."""

from dataclasses import dataclass
from enum import Enum

from groundstation.arrays import FloatArray
from groundstation.session.folder import Session


class AntennaSource(Enum):
    """What states the antenna's position."""

    SESSION = "[target] of session.toml"
    RIG = "[reference] of the rig"
    NONE = "neither [target] of session.toml nor [reference] of the rig"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AntennaPosition:
    """Position of the antenna from the nose.

    Attributes
    ----------
    in_body_m : (3,) x forward, y right, z down; None if nothing states it.
    sigma_m : (3,) one sigma of each, where the rig states the position with it; else None.
    source : what states it.
    """

    in_body_m: FloatArray | None
    sigma_m: FloatArray | None
    source: AntennaSource

    @property
    def words(self) -> str:
        """The position in m, as in "-1.20 forward, 0.00 right, -0.30 down of the nose"; "" if unknown."""
        if self.in_body_m is None:
            return ""
        x, y, z = (float(v) for v in self.in_body_m)
        return f"{x:.2f} forward, {y:.2f} right, {z:.2f} down of the nose, in m"


def antenna_position(session: Session) -> AntennaPosition:
    """Return the antenna's position; session.toml has precedence over the rig."""
    stated, reference = session.target.antenna_in_body_m, session.rig.reference
    if stated is not None:
        return AntennaPosition(in_body_m=stated, sigma_m=None, source=AntennaSource.SESSION)
    if reference is not None and reference.antenna_in_body_m is not None:
        return AntennaPosition(
            in_body_m=reference.antenna_in_body_m, sigma_m=reference.antenna_sigma_m, source=AntennaSource.RIG
        )
    return AntennaPosition(in_body_m=None, sigma_m=None, source=AntennaSource.NONE)
