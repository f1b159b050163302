"""`groundstation plan` as a user meets it: the example works, files lie where they should, faults are one line."""

import contextlib
import io
from pathlib import Path

import pytest

from groundstation.cli.main import main

EXAMPLE = Path(__file__).resolve().parents[2] / "docs" / "site-example.toml"


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str, str]:
    """The example planned into a folder that is not there yet: the folder, what is printed, and the errors."""
    out = tmp_path_factory.mktemp("planned") / "new" / "plan"
    printed, faults = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(faults):
        assert main(["plan", str(EXAMPLE), "--out", str(out)]) == 0
    return out, printed.getvalue(), faults.getvalue()


def test_the_example_is_planned_and_drawn(planned: tuple[Path, str, str]) -> None:
    out, printed, faults = planned
    assert sorted(p.name for p in out.iterdir()) == ["plan.csv", "plan.png", "plan.svg"]
    assert (out / "plan.png").read_bytes().startswith(b"\x89PNG")
    svg = (out / "plan.svg").read_text(encoding="utf-8")
    assert "along the runway" in svg
    assert "good enough for flare (0.3/1/0.15 m) at 60-180 m" in printed
    assert [line for line in printed.splitlines() if line.startswith("wrote")] == [
        f"wrote {out / name}" for name in ("plan.csv", "plan.png", "plan.svg")
    ]
    assert not faults


def test_the_same_plan_is_the_same_file(planned: tuple[Path, str, str], tmp_path: Path) -> None:
    assert main(["plan", str(EXAMPLE), "--out", str(tmp_path / "again")]) == 0
    for name in ("plan.csv", "plan.png", "plan.svg"):
        assert (planned[0] / name).read_bytes() == (tmp_path / "again" / name).read_bytes(), name


def test_without_a_folder_it_only_prints(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", str(EXAMPLE)]) == 0
    reported = capsys.readouterr().out
    assert "wrote" not in reported
    assert len(reported.splitlines()) > 12


def test_a_plan_without_views_is_still_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Two stations above each other do not determine range; there is a picture without any curve."""
    text = EXAMPLE.read_text(encoding="utf-8").replace("baseline_m = 10.77\nheight_m = 1.5 ", "#")
    site = tmp_path / "site.toml"
    station = "[[station]]\nposition_m = [0.0, 0.0, 1.5]\n"
    site.write_text(text.replace("\n[camera]", f"\n{station}{station}[camera]"))
    assert main(["plan", str(site), "--out", str(tmp_path / "out")]) == 0
    reported = capsys.readouterr()
    assert "no position at 60-600 m" in reported.out
    assert not reported.err


@pytest.mark.parametrize(("site", "message"), [("none.toml", "none.toml: got no such file; wanted a TOML file")])
def test_a_fault_is_one_line(tmp_path: Path, site: str, message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", str(tmp_path / site)]) == 1
    reported = capsys.readouterr()
    assert reported.err == f"groundstation: {tmp_path}/{message}\n"
    assert not reported.out


def test_the_folder_may_not_be_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "out").write_text("")
    assert main(["plan", str(EXAMPLE), "--out", str(tmp_path / "out")]) == 1
    assert capsys.readouterr().err == f"groundstation: {tmp_path / 'out'}: got a file; wanted a folder\n"
