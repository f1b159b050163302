"""One job of the bank: a world drawn, rendered, replayed and scored."""

import base64
import math
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from groundstation.bank.baseline import baseline_row
from groundstation.bank.contact_sheet import contact_sheet
from groundstation.bank.frame_classes import frame_class_row
from groundstation.bank.frame_outcomes import frame_outcomes
from groundstation.bank.rendered_worlds import rendered_world
from groundstation.bank.session_figures import session_figures
from groundstation.bank.session_truth import SessionTruth
from groundstation.errors import SessionError
from groundstation.replay.replay import ReplayRequest, replay
from groundstation.session import load_session
from groundstation.simulation.world.draw_world import draw_world
from groundstation.simulation.world.world import world_factors

# of the figures in a row: the last bits of a sum depend on how a machine's libraries order it
_DIGITS = 9


@dataclass(frozen=True, slots=True, kw_only=True)
class WorldJob:
    """Parameters of a worker's job: the world's seed, duration in s and rate in Hz, and options of the replay.

    ``tuning`` is the text of a configuration file, or None for the defaults; ``csrt_python`` the executable of an
    environment with OpenCV's CSRT, or None to leave the baseline out; ``worlds`` the folder where rendered worlds are
    kept, or None to keep none.
    """

    seed: int
    duration_s: float
    frame_hz: float
    tuning: str | None = None
    csrt_python: str | None = None
    worlds: str | None = None


def score_world(job: WorldJob) -> dict[str, Any]:
    """Return the ``row`` of a world (factors and figures by name) and a ``sheet`` of its worst frames, JPEG in base64.

    Raises `GroundstationError` where the world cannot be rendered or its session not be replayed to the end.
    """
    world = draw_world(job.seed, duration_s=job.duration_s, frame_hz=job.frame_hz)
    with tempfile.TemporaryDirectory(prefix="groundstation-bank-") as name:
        folder = Path(name)
        session = rendered_world(world, folder if job.worlds is None else Path(job.worlds))
        config = None
        if job.tuning is not None:
            config = folder / "tuning.toml"
            config.write_text(job.tuning, encoding="utf-8")
        request = ReplayRequest(session=session, out=folder / "out", config=config, rerun=False, report=False)
        result = replay(request)
        if result.fault is not None:
            raise SessionError(
                f"world {job.seed}", got=str(result.fault), wanted="a session that is replayed to its end"
            )
        truth = SessionTruth(load_session(session))
        outcomes = frame_outcomes(truth, result.evaluation)
        row = {
            "seed": job.seed,
            **{f"factor {name}": value for name, value in world_factors(world).items()},
            **session_figures(truth, result.evaluation, outcomes).to_row(),
            **frame_class_row(truth, outcomes),
        }
        if job.csrt_python is not None:
            row |= baseline_row(truth, Path(job.csrt_python))
        sheet = contact_sheet(truth, outcomes)
    return {
        "row": {name: _rounded(value) for name, value in row.items()},
        "sheet": base64.b64encode(sheet).decode("ascii"),
    }


def _rounded(value: Any) -> Any:
    """Return a figure to `_DIGITS` digits, None where it is not finite; other values as they are."""
    if not isinstance(value, float):
        return value
    return float(f"{value:.{_DIGITS}g}") if math.isfinite(value) else None
