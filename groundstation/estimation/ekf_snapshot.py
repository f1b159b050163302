"""Snapshot of the filter; a further variable of the filter is a field of `EkfBookkeeping`, and nothing else."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from groundstation.estimation.clock_monitor import ClockMonitor
from groundstation.estimation.imm import ImmState
from groundstation.estimation.journal import JournalMark
from groundstation.estimation.provisional_track import ProvisionalTrack
from groundstation.estimation.rejected_pixels import RejectedPixels
from groundstation.estimation.updates.reference_update import ReferenceHistory
from groundstation.estimation.velocity_structure import VelocityStructure


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EkfBookkeeping:
    """Variables of the filter besides mean, covariance and time; replaced as a whole, never written to.

    Attributes
    ----------
    clock_monitor : observability of the PTU clocks.
    first_s : time of the first prediction, from which clocks drift.
    stations_read : stations whose angles are initialised by a reading.
    references : outcome of the previous reference positions.
    provisional : counts of the pixels of a track that is not confirmed yet.
    restarts : number of provisional tracks that were restarted.
    newest_pixel_s : time of the last accepted pixel of each station; only kept with three or more stations.
    newest_width_s : time of the last silhouette width of this target.
    pixel : station and time of the last accepted pixel of this target.
    two_cameras_s : when two cameras last saw this target together, or when it was started.
    velocity : how this target's velocity changes.
    rejected : pixels that the gate rejected since the last accepted one.
    """

    clock_monitor: ClockMonitor
    has_target: bool = False
    first_s: float | None = None
    stations_read: frozenset[str] = frozenset()
    references: ReferenceHistory = field(default_factory=ReferenceHistory)
    provisional: ProvisionalTrack | None = None
    restarts: int = 0
    newest_pixel_s: Mapping[str, float] = field(default_factory=dict)
    newest_width_s: float | None = None
    pixel: tuple[str, float] | None = None
    two_cameras_s: float | None = None
    velocity: VelocityStructure = field(default_factory=VelocityStructure)
    rejected: RejectedPixels = field(default_factory=RejectedPixels)


class EkfSnapshot(NamedTuple):
    """Complete state of the filter at ``time_s``, with the position in its journal; read-only."""

    time_s: float | None
    imm: ImmState
    bookkeeping: EkfBookkeeping
    journal: JournalMark | None
