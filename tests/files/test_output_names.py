"""A name that a file brings along is one plain component below the output, or nothing is written under it."""

import ast
import re
from pathlib import Path

import numpy as np
import pytest

from calibration.report.picture import ReportPicture, write_page
from groundstation.cli.main import main
from groundstation.errors import InputError, RigError
from groundstation.files.output_names import MAX_NAME_BYTES, below, name_fault
from groundstation.recording.recorder import PATIENT, Recorder
from groundstation.rig.rig import load_rig
from tests.hostile.records import rewritten
from tests.recording.recorded import FILES, events, header, looked_at, small_rig
from tests.session.folder import rig_text

ROOT = Path(__file__).resolve().parents[2]
REFUSED = (
    *("", ".", "..", "../x", "../../x", "a/b", "/tmp/x", "\\x", "..\\x", "C:x", "C:\\x", "a\0b", "a\nb", "\x1b[2J"),
    *("x" * (MAX_NAME_BYTES + 1), "é" * 150, "a ", " a", "a.", "con", "NUL", "aux.csv", "Lpt1.txt", "COM¹", "a:b"),
    *("\ud800", "a*", "a?", 'a"', "a|b", "a<b"),
)
TAKEN = ("left.mp4", "000000.png", "session.toml", "links-außen", "a b", ".hidden", "console", "nul-1", "...x", "com10")


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_plain_component_is_refused_in_one_line(name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as fault:
        below(tmp_path, name)
    assert str(fault.value).isprintable()
    assert len(str(fault.value)) < 400 + len(str(tmp_path))


@pytest.mark.parametrize("name", TAKEN)
def test_plain_names_are_unchanged(name: str, tmp_path: Path) -> None:
    assert name_fault(name) is None
    assert below(tmp_path, name) == tmp_path / name


def test_a_link_in_the_output_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").write_text("kept")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "left").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(InputError, match="a symbolic link"):
        below(tmp_path / "out", "left")


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recording") / "flight.mcap"
    with Recorder(path, small_rig(), header(), PATIENT, free_bytes=lambda: 10**12) as recorder:
        for event in recorder.taken(events(2, np.random.default_rng(1))):
            recorder.write(looked_at(event))
    return path


@pytest.mark.parametrize(
    "name", ["../planted.txt", "../../planted.txt", "ABSOLUTE", "left/000000.png", "..", "a\0b", ""]
)
def test_convert_writes_no_attachment_outside_its_folder(
    name: str, recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Expected: one line of error, and outside the folder everything as before."""
    below_it = tmp_path / "a" / "b"
    below_it.mkdir(parents=True)
    name = str(tmp_path / "planted.txt") if name == "ABSOLUTE" else name
    hostile = rewritten(recording, below_it / "flight.mcap", {name: b"planted"})
    assert main(["convert", str(hostile), str(below_it / "out")]) == 1
    reported = [line for line in capsys.readouterr().err.splitlines() if line.startswith("groundstation: ")]
    assert len(reported) == 1
    assert "name" in reported[0]
    assert {p.name for p in tmp_path.iterdir()} == {"a"}
    assert {p.name for p in (tmp_path / "a").iterdir()} == {"b"}
    assert {p.name for p in below_it.iterdir()} == {"flight.mcap"}
    assert not any(p.read_bytes() == b"planted" for p in tmp_path.rglob("*") if p.is_file())


def test_an_attachment_takes_the_place_of_no_table(recording: Path, tmp_path: Path) -> None:
    """Expected: the recording's own readings are not replaced by, and do not replace, an attachment of their name."""
    hostile = rewritten(recording, tmp_path / "flight.mcap", {"ptu.csv": b"planted"})
    assert main(["convert", str(hostile), str(tmp_path / "out")]) == 1


@pytest.mark.parametrize("name", ["../left", "a/b", "con", "NUL", "x" * 65, "é" * 101, "", "..", "a b"])
def test_a_station_has_a_name_that_files_can_have(name: str, tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(rig_text(["left", name]), encoding="utf-8")
    with pytest.raises(RigError, match="name"):
        load_rig(path)


def test_stations_differ_by_more_than_upper_and_lower_case(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(rig_text(["left", "Left"]))
    with pytest.raises(RigError, match="upper and lower case"):
        load_rig(path)


def test_a_recorded_rig_is_held_to_the_same(recording: Path, tmp_path: Path) -> None:
    planted = FILES["rig.toml"].replace(b'name = "left"', b'name = "../../left"')
    hostile = rewritten(recording, tmp_path / "flight.mcap", {"rig.toml": planted})
    assert main(["convert", str(hostile), str(tmp_path / "out")]) == 1
    assert not (tmp_path / "out").exists()


def test_a_report_picture_is_below_its_report(tmp_path: Path) -> None:
    picture = ReportPicture(name="../planted", title="", caption="", png=b"planted")
    with pytest.raises(InputError, match="a plain file name"):
        write_page(tmp_path / "report", "", [picture])
    assert not (tmp_path / "planted.png").exists()


# a name put together of data is joined to a folder nowhere but here
ASKED = re.compile(r"groundstation/output_names\.py")
# without this in its text a file has no division by a string, formatted or not, and need not be parsed
DIVIDED_BY_TEXT = re.compile(r"""/(?:[\s(\\]|\#[^\n]*\n)*[a-zA-Z]{0,2}["']""")
# what is joined to a folder is a number, or a constant of the program
OF_OURS = {"groundstation/simulation/device_simulator.py", "groundstation/simulation/simulated_station_file.py"}


@pytest.mark.parametrize("package", ["groundstation", "calibration"])
def test_composed_names_are_joined_to_folders_by_below_alone(package: str) -> None:
    """Expected: no `folder / f"…"` outside; the links of simulated heads, named by checked stations, are replaced."""
    found = []
    for path in sorted((ROOT / package).rglob("*.py")):
        name = path.relative_to(ROOT).as_posix()
        if ASKED.fullmatch(name) or name in OF_OURS:
            continue
        text = path.read_text(encoding="utf-8")
        if not DIVIDED_BY_TEXT.search(text):
            continue
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Div) and isinstance(node.right, ast.JoinedStr):
                found.append(f"{name}:{node.lineno}")
    assert not found


@pytest.mark.parametrize(
    "written", ['a / f"x"', 'a/f"x"', 'a / (  # why\n f"x")', 'a / ("p" f"x")', 'a /\\\n rf"x"', "a / F'''{x}'''"]
)
def test_no_division_by_text_is_overlooked(written: str) -> None:
    assert any(isinstance(n, ast.BinOp) and isinstance(n.right, ast.JoinedStr) for n in ast.walk(ast.parse(written)))
    assert DIVIDED_BY_TEXT.search(written)
