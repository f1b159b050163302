"""A session file that states nothing is allowed, and noted."""

from pathlib import Path

import pytest

from groundstation.replay.replay_inputs import load_inputs
from groundstation.replay.replay_request import ReplayRequest
from tests.session.folder import Tiny


@pytest.mark.parametrize(("text", "noted"), [("", True), ("# nothing yet\n", True), ('name = "first"\n', False)])
def test_an_empty_session_file_is_noted(text: str, noted: bool, tmp_path: Path) -> None:
    folder = Tiny(rows=2, video="png").write(tmp_path / "session")
    (folder / "session.toml").write_text(text, encoding="utf-8")
    notes = load_inputs(ReplayRequest(session=folder, out=tmp_path / "out")).notes
    line = "session.toml is empty: the aircraft's span, the place on Earth and the phases are unknown"
    assert (line in notes) is noted
