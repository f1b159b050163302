"""The header of a replay's recording."""

from dataclasses import replace
from pathlib import Path

import pytest

from groundstation.cli.main import main
from groundstation.messages import Event, PtuSample
from groundstation.rig.rig_toml import rig_to_toml
from groundstation.session import load_session
from tests.recording.recorded import small_rig
from tests.sources.test_recorrection import AXES, recorded, replayed, rig_with, session_events

pytestmark = pytest.mark.usefixtures("unrendered_figures")


def readings(events: list[Event]) -> list[PtuSample]:
    return [event for event in events if isinstance(event, PtuSample)]


def test_a_replay_of_an_early_recording_records_whether_it_is_corrected(tmp_path: Path) -> None:
    """Expected: as it was flown its events stay uncorrected, and say so; by --rig they are corrected by that rig."""
    rig = rig_with(replace(AXES, pan_backlash_rad=1e-3), -0.037, 0.012)
    early = recorded(tmp_path, rig, session_events(small_rig()), corrected=False)
    flown, corrected, own = (tmp_path / name for name in ("flown.mcap", "corrected.mcap", "own.toml"))
    own.write_text(rig_to_toml(rig))
    for path, options in ((flown, []), (corrected, ["--rig", str(own)])):
        out = ["--out", str(tmp_path / path.stem), "--no-rerun", "--record", str(path)]
        assert main(["replay", str(early), *options, *out]) == 0
    wanted = readings(replayed(early, own))
    assert readings(replayed(flown)) == readings(replayed(early)) != wanted
    for path in (flown, corrected):
        assert readings(replayed(path, own)) == wanted
    assert readings(replayed(corrected)) == wanted
    headers = [session.recorded.header for session in map(load_session, (flown, corrected)) if session.recorded]
    assert [header.corrected for header in headers] == [False, True]
