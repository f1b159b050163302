"""Cameras without pictures for a whole replay, or at its beginning or its end."""

from collections.abc import Mapping

import numpy as np

from groundstation.arrays import FloatArray

# cameras that start one after the other, by hand, are not worth a note; it is how long a station may be silent
# before it is reported (`IntegrityConfig.silent_s`)
_SHORT_S = 2.0


def camera_notes(stamps_s: Mapping[str, FloatArray], to_s: float) -> list[str]:
    """Return a note on each station whose pictures begin later, or end earlier, than those of others.

    ``stamps_s`` are session times (n,) by station, NaN where there is no picture; what is later than ``to_s`` was not
    asked for.
    """
    seen = {name: t[np.isfinite(t) & (t <= to_s)] for name, t in stamps_s.items()}
    some = [t for t in seen.values() if len(t)]
    if not some:
        return []
    first_s, last_s = min(float(t.min()) for t in some), max(float(t.max()) for t in some)
    notes = []
    for name, t in seen.items():
        if not len(t):
            notes.append(f"{name}: no picture from {first_s:.1f} to {last_s:.1f} s, where other stations have some")
        elif t.min() - first_s > _SHORT_S or last_s - t.max() > _SHORT_S:
            notes.append(
                f"{name}: pictures from {t.min():.1f} to {t.max():.1f} s only, of {first_s:.1f} to {last_s:.1f} s"
            )
    return notes
