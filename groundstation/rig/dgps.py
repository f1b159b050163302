"""The DGPS in a rig file: its clock offset to the session, and the position of its antenna.

Both are results of a flight calibration; recordings are not edited, so the rig file contains them.
"""

from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.errors import RigError
from groundstation.files.toml_table import TomlTable

_MOST_NAME_CHARACTERS = 200
# an antenna is on the aircraft: so far from the nose, in m and in wing spans (a slender one's length is two)
_FARTHEST_ANTENNA_M, _FARTHEST_ANTENNA_SPANS = 100.0, 5.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RigReference:
    """The table ``[reference]`` of a rig file; every part may be missing.

    Attributes
    ----------
    session : identity of the session that the clock belongs to; empty, it holds for all.
    offset_s, offset_sigma_s : t_dgps = t_session + offset, and one sigma; None if not given.
    antenna_in_body_m, antenna_sigma_m : (3,) from the nose: x forward, y right, z down; None if not given.
    """

    session: str = ""
    offset_s: float | None = None
    offset_sigma_s: float = 0.0
    antenna_in_body_m: FloatArray | None = None
    antenna_sigma_m: FloatArray | None = None

    def clock_for(self, session: str) -> float | None:
        """Return the offset in s if it holds for the session of that identity, else None."""
        return self.offset_s if self.session in ("", session) else None


def read_antenna(table: TomlTable, span_m: float | None = None) -> FloatArray | None:
    """Read where the antenna is from the nose, m; None where the table does not say; ``span_m`` is the aircraft's."""
    key = "antenna_in_body_m"
    if key not in table:
        return None
    antenna = table.vector(key, 3)
    if np.linalg.norm(antenna) > _FARTHEST_ANTENNA_M:
        raise table.fail(key, str(antenna.tolist()), f"metres from the nose, at most {_FARTHEST_ANTENNA_M:g}")
    if span_m is not None and np.linalg.norm(antenna) > _FARTHEST_ANTENNA_SPANS * span_m:
        wanted = f"metres from the nose, on an aircraft of {span_m:g} m span"
        raise table.fail(key, str(antenna.tolist()), wanted)
    return antenna


def read_reference(table: TomlTable) -> RigReference:
    """Read ``[reference]``; raises `RigError` for an unknown key or a number that cannot be."""
    table.refuse_unknown({"session", "dgps_clock", "antenna_in_body_m", "antenna_sigma_m"})
    session = table.text("session", "")
    if len(session) > _MOST_NAME_CHARACTERS:
        raise table.fail("session", f"{len(session)} characters", f"at most {_MOST_NAME_CHARACTERS}")
    offset: float | None = None
    sigma = 0.0
    if "dgps_clock" in table:
        clock = table.table("dgps_clock")
        clock.refuse_unknown({"offset_s", "sigma_s"})
        offset, sigma = clock.number("offset_s"), clock.number("sigma_s", 0.0, minimum=0.0)
    antenna_sigma: FloatArray | None = None
    antenna = read_antenna(table)
    if antenna is not None:
        antenna_sigma = table.vector("antenna_sigma_m", 3, (0.0, 0.0, 0.0))
        if np.any(antenna_sigma < 0.0):
            raise table.fail("antenna_sigma_m", str(antenna_sigma.tolist()), "three numbers >= 0")
    elif "antenna_sigma_m" in table:
        raise RigError(table.where, got="antenna_sigma_m alone", wanted="antenna_in_body_m with it")
    return RigReference(
        session=session,
        offset_s=offset,
        offset_sigma_s=sigma,
        antenna_in_body_m=antenna,
        antenna_sigma_m=antenna_sigma,
    )
