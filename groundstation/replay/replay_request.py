"""Arguments of a replay and its result."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from groundstation.approach.approach_options import ApproachOptions
from groundstation.approach.approach_outputs import ApproachSummary
from groundstation.detection.detector_callback import DetectorCallback
from groundstation.errors import InputError, UsageError
from groundstation.evaluation.evaluate import Evaluation
from groundstation.session import Session
from groundstation.sinks.output_comparison import OutputComparison
from groundstation.tracking.registered_heads import AnglesFromPicture


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayRequest:
    """Arguments of a replay; ``rig`` and ``config`` None select the session's rig and tuning (or the defaults).

    Up to ``learn_until_s`` of its clock the DGPS updates the filter and its calibration states; None uses it for
    comparison only. ``smooth`` also writes the smoothed track. ``record`` is the path of a recording to write.
    ``panorama`` is a file of `calibrate panorama`: frames' angles are then the pictures' own. ``stars`` makes of the
    session what takes them from stars, by station.
    ``weights`` are one's own for the learned channel, which then detects.
    ``command`` are the words of the command line, if there was one, for the record.
    ``report`` False leaves out report.html, whose figures take longer than a short replay.
    ``detector`` is a function in place of the program's own detector, one for all stations or one for each by name.
    ``approach`` asks for advice, landing reports, an autopilot's stream, JSON lines. ``realtime`` replays at the speed
    of the recording, as streams need it.
    """

    session: Path
    out: Path
    rig: Path | None = None
    config: Path | None = None
    from_s: float | None = None
    to_s: float | None = None
    learn_until_s: float | None = None
    rerun: bool = True
    smooth: bool = False
    record: Path | None = None
    report: bool = True
    weights: Path | None = None
    panorama: Path | None = None
    stars: Callable[[Session], Mapping[str, AnglesFromPicture]] | None = None
    command: tuple[str, ...] = ()
    detector: DetectorCallback | Mapping[str, DetectorCallback] | None = None
    approach: ApproachOptions = field(default_factory=ApproachOptions)
    realtime: bool = False

    def __post_init__(self) -> None:
        if (self.approach.autopilot is not None or self.approach.udp is not None) and not self.realtime:
            raise UsageError("--autopilot, --udp", got="no --realtime", wanted="it: a stream is of its own time")

    @property
    def unmodified(self) -> bool:
        """Whether a recording is replayed with its own rig, tuning and time span."""
        set_up = (self.rig, self.config, self.detector, self.panorama, self.stars)
        return all(v is None for v in (*set_up, self.from_s, self.to_s, self.learn_until_s))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReplayResult:
    """Result of a replay: the evaluation, the files written, and the fault that ended the run early, if any.

    ``given_up`` are the recordings that were wanted and for which there was no room, each with the reason.
    ``approach`` is what came of the outputs of an approach, None where none were asked for.
    ``output_comparison`` compares the outputs with the recorded ones, for a recording replayed unmodified; else None.
    """

    evaluation: Evaluation
    files: tuple[Path, ...]
    fault: InputError | None
    output_comparison: OutputComparison | None = None
    given_up: Mapping[Path, str] = field(default_factory=dict)
    approach: ApproachSummary | None = None
