"""Visibility of the aircraft in the frames of a rendered session, and its true silhouettes."""

from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray, MaskArray
from groundstation.errors import SessionError
from groundstation.session import Session, load_truth
from groundstation.sources.frame_table import FrameTable, read_frames
from groundstation.sources.true_silhouettes import SilhouetteArchive, TrueSilhouette
from groundstation.sources.visibility_table import FrameVisibility, read_visibility

# what counts as a visible frame, fixed before any detector was run on the bank
LEAST_WIDTH_PX = 10.0
LEAST_SNR = 8.0
LEAST_SHARE_SEEN = 0.2


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrameSilhouette:
    """Truth of one frame: its silhouette in the picture, and whether it is ``visible`` by the rules above."""

    silhouette: TrueSilhouette
    visible: bool


class SessionTruth:
    """Truth of a rendered session by station and pair.

    Where the session has no visibility.csv (recordings of other renderers), a frame is visible when its silhouette
    inside the picture is wide enough: occlusion and contrast are unknown. ``rated`` distinguishes the two.

    Raises `SessionError` for a session without truth.csv or masks.npz.
    """

    def __init__(self, session: Session) -> None:
        if load_truth(session) is None:
            raise SessionError(session.name, got="no truth.csv", wanted="a rendered session with its truth")
        self.session = session
        self._silhouettes = SilhouetteArchive(session)
        self._visibility = read_visibility(session)
        self._frames: FrameTable = read_frames(session)

    @property
    def rated(self) -> bool:
        """Whether signal-to-noise ratio and hidden share of each frame are known."""
        return self._visibility is not None

    @property
    def pairs(self) -> int:
        """Number of pairs."""
        return len(self._frames.index)

    def taken(self, station: str, pair: int) -> bool:
        """Return whether a station delivered a frame of this pair."""
        return bool(np.isfinite(self._frames.stamps_s[station][pair]))

    def frame(self, station: str, pair: int) -> FrameSilhouette | None:
        """Return the truth of a frame; None where the aircraft is not in the picture."""
        silhouette = self._silhouettes.find(station, pair)
        if silhouette is None:
            return None
        return FrameSilhouette(silhouette=silhouette, visible=self._visible(station, pair, silhouette))

    def visible_pairs(self) -> dict[str, MaskArray]:
        """Return by station in which pairs (n,) a frame was delivered and shows the aircraft by the rules."""
        masks: dict[str, MaskArray] = {}
        for station in self.session.rig.names:
            found = np.zeros(self.pairs, dtype=np.bool_)
            for pair in range(self.pairs):
                truth = self.frame(station, pair) if self.taken(station, pair) else None
                found[pair] = truth is not None and truth.visible
            masks[station] = found
        return masks

    def rating(self, station: str, pair: int) -> FrameVisibility | None:
        """Return the renderer's rating of a frame; None where there is none."""
        if self._visibility is None:
            return None
        return self._visibility.get((station, int(self._frames.index[pair])))

    def _visible(self, station: str, pair: int, silhouette: TrueSilhouette) -> bool:
        if self._visibility is None:
            return silhouette.width_px >= LEAST_WIDTH_PX
        seen = self.rating(station, pair)
        return (
            seen is not None
            and seen.width_px >= LEAST_WIDTH_PX
            and seen.snr >= LEAST_SNR
            and seen.share_seen >= LEAST_SHARE_SEEN
        )


def distance_outside_px(silhouette: TrueSilhouette, pixel_px: FloatArray) -> float:
    """Return how far a pixel (2,) is from the nearest pixel of a silhouette, px; 0 inside."""
    rows, columns = np.nonzero(silhouette.mask)
    return float(np.hypot(silhouette.x + columns - pixel_px[0], silhouette.y + rows - pixel_px[1]).min())
