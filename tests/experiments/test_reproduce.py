"""The papers' experiments: the registry, each on a tiny stretch of the bundled landing, and that they repeat."""

import base64
import csv
import hashlib
import pickle
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from groundstation.arrays import ImageArray
from groundstation.cli.main import main
from groundstation.errors import InputError
from groundstation.experiments.canny import canny_edges
from groundstation.experiments.experiment import Findings
from groundstation.experiments.html_report import paper_page
from groundstation.experiments.localisation import failing
from groundstation.experiments.onboard_energies import FLAT, HOUGH, PRINTED, EnergyApproach, deciding, order_words
from groundstation.experiments.onboard_pictures import PANEL_PX, panel, sheet
from groundstation.experiments.registry import EXPERIMENTS, named
from groundstation.experiments.reproduce import ReproduceRequest, reproduce
from groundstation.experiments.tables import ResultTable
from groundstation.experiments.truth_session import TruthSession
from groundstation.onboard.edges.pose import NoseCameraPose
from groundstation.onboard.scenes.sequences import NoseFrame, Renderer
from tests.docs.long_blocks import run_by_test
from tests.docs.pages import ROOT
from tests.docs.run_blocks import run_blocks

# near the start, where little has to be decoded
FROM_S, TO_S = 2.0, 2.5
# what MATHS of the ground paper asks for, by the paper's numbers
WANTED = (
    *("table 1", "table 2", "table 3", "table 4", "table 5"),
    *("figure 8", "figure 9", "figure 10", "figure 11", "figure 12", "figure 13", "figure 14"),
)


@pytest.fixture(scope="module")
def recorded(landing_1: Path) -> TruthSession:
    return TruthSession(landing_1, FROM_S, TO_S)


@pytest.fixture(scope="module")
def drawn_once() -> Iterator[None]:
    """A picture of the nose's camera is drawn once; that it is the same again is tested in `tests/onboard/scenes`."""
    drawn: dict[bytes, ImageArray] = {}
    draw = Renderer.picture

    def picture(self: Renderer, pose: NoseCameraPose, noise_seed: int = 0) -> ImageArray:
        key = hashlib.sha256(pickle.dumps((self.sequence, self.lens, pose, noise_seed))).digest()
        if key not in drawn:
            drawn[key] = draw(self, pose, noise_seed)
        return drawn[key].copy()

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Renderer, "picture", picture)
        yield


@pytest.fixture(scope="module")
def found(recorded: TruthSession, drawn_once: None) -> dict[str, Findings]:
    """Every experiment done once on the stretch."""
    return {e.name: e.run(recorded) for e in EXPERIMENTS}


@pytest.fixture(scope="module")
def again(tmp_path_factory: pytest.TempPathFactory, drawn_once: None) -> Path:
    """What the documentation's own lines leave: all experiments on the same stretch once more, from the pictures on."""
    folder = tmp_path_factory.mktemp("page")
    with pytest.MonkeyPatch.context() as patch:
        # labels may overlap: to place them takes half of the time of drawing
        patch.setattr("matplotlib.figure.Figure.get_layout_engine", lambda figure: None)
        patch.setattr("groundstation.experiments.detection_plots.PNG_DPI", 40)
        run_blocks(run_by_test(ROOT / "docs" / "reproduce.md"), folder, patch, [])
    return folder / "out" / "reproduce"


def untimed(folder: Path, table: ResultTable) -> list[list[str]]:
    """Return a table as it was written to a folder, without its times."""
    with (folder / f"{table.name}.csv").open(newline="", encoding="utf-8") as stream:
        rows = list(csv.reader(stream))
    assert len(rows) == len(table.rows) + 1
    return [[cell for k, cell in enumerate(row) if k not in table.timed] for row in rows]


def test_every_number_of_the_ground_paper_is_there() -> None:
    numbers = "; ".join(e.numbers.replace(" and ", ", figure ") for e in EXPERIMENTS)
    for wanted in WANTED:
        assert re.search(rf"{wanted}\b", numbers), wanted
    assert len({e.name for e in EXPERIMENTS}) == len(EXPERIMENTS)
    for e in EXPERIMENTS:
        assert re.fullmatch(r"[a-z][a-z-]*", e.name)
        assert named(e.name) is e


@pytest.mark.parametrize("name", [e.name for e in EXPERIMENTS])
def test_each_finds_something(name: str, found: dict[str, Findings], again: Path) -> None:
    findings = found[name]
    assert findings.tables
    for table in findings.tables:
        assert table.rows
        assert all(len(row) == len(table.columns) for row in table.rows)
        numbers = [cell for row in table.rows for cell in row if isinstance(cell, float)]
        # the one table that only counts: its frames and failures are whole numbers
        assert bool(numbers) == (table.name != "failures_near_ground"), table.name
        assert any(isinstance(cell, int | float) for row in table.rows for cell in row), table.name
        assert np.isfinite(numbers).all()
    for figure in findings.figures:
        # as the command drew it
        assert (again / f"{figure.name}.png").read_bytes().startswith(b"\x89PNG")


def test_names_of_files_do_not_clash(found: dict[str, Findings]) -> None:
    tables = [t.name for f in found.values() for t in f.tables]
    figures = [g.name for f in found.values() for g in f.figures]
    assert len(set(tables)) == len(tables)
    assert len(set(figures)) == len(figures)


@pytest.mark.parametrize("name", [e.name for e in EXPERIMENTS])
def test_the_same_again(name: str, found: dict[str, Findings], again: Path, tmp_path: Path) -> None:
    """Expected: all but the times is the same to the last digit."""
    for table in found[name].tables:
        table.write_csv(tmp_path)
        assert untimed(tmp_path, table) == untimed(again, table)


def test_nothing_is_there_but_once_more(found: dict[str, Findings], again: Path) -> None:
    """Expected: the same tables and the same figures, none more and none less, and the page."""
    tables = {f"{table.name}.csv" for findings in found.values() for table in findings.tables}
    figures = {f"{figure.name}.png" for findings in found.values() for figure in findings.figures}
    assert {path.name for path in again.iterdir()} == tables | figures | {"reproduce.html"}


def rows_of(table: ResultTable, *, where: str) -> Iterator[list[object]]:
    return (list(row) for row in table.rows if where in str(row[0]))


def test_errors_of_detection_go_into_y_most(found: dict[str, Findings]) -> None:
    """Expected: the paper's statement, and errors that grow with the pixels' in the direction that is off."""
    (table,) = found["sensitivity"].tables
    off = [list(row[2:5]) for row in rows_of(table, where="(a)")]
    values = np.array(off, dtype=np.float64)
    assert np.all(np.diff(values, axis=0) > 0)
    assert values[-1, 1] > 5 * max(values[-1, 0], values[-1, 2])
    u_only = np.array([row[2:5] for row in rows_of(table, where="(b)")], dtype=np.float64)
    v_only = np.array([row[2:5] for row in rows_of(table, where="(c)")], dtype=np.float64)
    assert u_only[-1, 0] > 20 * v_only[-1, 0]
    assert np.all(values[0] < 1e-6)


def test_the_papers_form_is_overconfident_out_of_view(found: dict[str, Findings]) -> None:
    table = found["out-of-view"].tables[1]
    for scene in "ABCD":
        anees = {str(row[1]): float(str(row[-1])) for row in rows_of(table, where=scene)}
        assert anees["the paper's"] > 20.0
        assert anees["T·K, Joseph"] < 0.2 * anees["the paper's"]
        assert anees["R/T"] < 0.5 * anees["the paper's"]


def test_constant_speed_makes_up_for_the_delay(found: dict[str, Findings]) -> None:
    (table,) = found["online"].tables
    for flight in ("landing", "take-off"):
        late, made_up = (float(str(row[4])) for row in list(rows_of(table, where=flight))[:2])
        assert made_up < 0.6 * late


def test_a_filmed_take_off_takes_the_simulated_ones_place(
    recorded: TruthSession, found: dict[str, Findings], landing_1: Path
) -> None:
    """Expected: the landing's rows stay to the last digit; the second flight's are those of its pictures."""
    filmed = TruthSession(landing_1, FROM_S, TO_S, take_off=recorded)
    filmed.__dict__["collected"] = recorded.collected
    findings = named("online").run(filmed)
    (before,), (after,) = found["online"].tables, findings.tables
    assert after.rows[:3] == before.rows[:3]
    assert [row[1:8] for row in after.rows[3:]] == [row[1:8] for row in after.rows[:3]]
    assert not any("simulated" in words for words in findings.differences)
    assert any("simulated" in words for words in found["online"].differences)


def test_only_the_stretch_is_spoilt(recorded: TruthSession) -> None:
    before = recorded.detected
    after, (from_s, to_s) = failing(before)
    assert FROM_S < from_s < to_s < TO_S
    for name, rows in before.items():
        inside = (rows[:, 0] >= from_s) & (rows[:, 0] <= to_s)
        assert inside.any()
        assert np.array_equal(after[name][~inside], rows[~inside])
        assert np.abs(after[name][inside, 1:] - rows[inside, 1:]).max() > 5.0


def test_canny_finds_a_step_and_nothing_in_a_plain_picture() -> None:
    step = np.zeros((60, 80))
    step[:, 40:] = 100.0
    edges = canny_edges(step, 1.0)
    assert edges[10:50, 39:41].any(axis=1).all()
    assert not edges[:, :36].any()
    assert not canny_edges(np.full((60, 80), 7.0), 1.0).any()


def test_the_page_has_both_sides_and_loads_nothing(found: dict[str, Findings], tmp_path: Path) -> None:
    shown = [(e, found[e.name]) for e in EXPERIMENTS]
    for findings in found.values():
        for figure in findings.figures:
            (tmp_path / f"{figure.name}.png").write_bytes(b"\x89PNG")
    page = paper_page("x < y", shown, tmp_path, ["Only a part."])
    assert "x &lt; y" in page
    for e in EXPERIMENTS:
        assert f"<section id='{e.name}'>" in page
    assert "67.16" in page
    assert "15.1831" in page
    assert not re.search(r"(src|href)\s*=\s*['\"](?!#|data:image/png;base64,)", page)
    images = re.findall(r"<img alt=\"([^\"]+)\" src=\"data:image/png;base64,([^\"]+)\">", page)
    assert len(images) == sum(len(f.figures) for f in found.values())
    assert all(len(alt) > 30 and base64.b64decode(data) for alt, data in images)


def test_one_by_command(landing_1: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "new" / "folder"
    call = ["reproduce", "--only", "canny", "--out", str(out), "--session", str(landing_1)]
    assert main([*call, "--from", "0.5", "--to", "0.6"]) == 0
    assert "Canny" in capsys.readouterr().out
    assert {p.name for p in out.iterdir()} == {"reproduce.html", "canny.csv", "canny.png"}
    with (out / "canny.csv").open(encoding="utf-8") as stream:
        assert [row[0] for row in csv.reader(stream)][1:] == ["1.0", "10.0", "20.0"]


@pytest.mark.parametrize(
    ("extra", "code", "words"),
    [
        (["--only", "nothing"], 2, "one of detectors"),
        (["--session", "nowhere"], 1, "no such folder"),
        (["--take-off", "nowhere"], 1, "no such folder"),
        (["--from", "500"], 1, "truth from"),
    ],
)
def test_wrong_input_is_one_line(
    extra: list[str], code: int, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["reproduce", "--out", str(tmp_path / "out"), *extra]) == code
    reported = capsys.readouterr().err
    assert words in reported
    assert reported.count("\n") == 1


@pytest.mark.parametrize(
    ("extra", "words"),
    [
        (["--from", "nan"], "wanted a session time in s"),
        (["--to", "inf"], "wanted a session time in s"),
        (["--from", "3", "--to", "2"], "wanted an end after the beginning"),
    ],
)
def test_a_part_that_is_none_is_wrong_usage(
    extra: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        code = main(["reproduce", "--out", str(tmp_path / "out"), *extra])
    except SystemExit as ended:
        code = int(ended.code or 0)
    assert code == 2
    reported = capsys.readouterr().err
    assert words in reported
    assert not (tmp_path / "out").exists()


def test_a_file_in_the_way_is_said(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("")
    with pytest.raises(InputError, match="out"):
        reproduce(ReproduceRequest(out=tmp_path / "out", only=("canny",), from_s=FROM_S, to_s=TO_S))


def test_the_list_names_all(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["reproduce", "--list"]) == 0
    reported = capsys.readouterr().out
    assert all(e.name in reported and e.numbers in reported for e in EXPERIMENTS)


def test_an_obstructed_file_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    part = ["--only", "runway-pose", "--from", str(FROM_S), "--to", str(FROM_S + 0.2)]
    for name in ("reproduce.html", "pose_range.csv"):
        (tmp_path / name).mkdir()
        assert main(["reproduce", *part, "--out", str(tmp_path)]) == 1
        assert f"{tmp_path / name}: got a folder; wanted a file that can be written" in capsys.readouterr().err
        (tmp_path / name).rmdir()
    (tmp_path / "taken").write_text("")
    assert main(["reproduce", *part, "--out", str(tmp_path / "taken")]) == 1
    assert f"{tmp_path / 'taken'}: got File exists; wanted a folder" in capsys.readouterr().err


def followed(name: str, variant_px: float, flat_px: float, hough_px: float = 50.0) -> EnergyApproach:
    """An approach with such errors in each of four pictures."""
    sizes = {PRINTED: variant_px, FLAT: flat_px, HOUGH: hough_px}
    picture = np.zeros((480, 640, 3), np.uint8)
    pose = NoseCameraPose(threshold_from_camera=np.eye(3), camera_threshold_m=np.zeros(3))
    return EnergyApproach(
        scene=name,
        seed=1,
        last=NoseFrame(index=0, t_s=0.0, image=picture, truth=pose, reported=pose),
        truth=(np.zeros(4), np.array([200.0, 300.0])),
        errors={method: np.full((4, 4), px) for method, px in sizes.items()},
    )


def test_what_decides_between_two_energies_is_named() -> None:
    """Expected: the approaches without which the order changes, the most influential first, and no other."""
    calm, lost, bad = followed("calm", 1.0, 0.8), followed("lost", 2.0, 40.0), followed("bad", 1.5, 20.0)
    every = [calm, bad, lost]
    assert deciding(every, PRINTED, FLAT) == [lost, bad]
    assert deciding(every, FLAT, PRINTED) == []
    assert deciding([bad, lost], PRINTED, FLAT) == [lost, bad]
    reported = order_words(every, PRINTED)
    assert "the paper's table 1 comes out" in reported
    assert "better one in 2 of 3 approaches" in reported
    assert (
        "lost 1 (40.0 px non-variant), bad 1 (20.0 px non-variant): without, it would be 1.0 against 0.8 px" in reported
    )
    assert "decides" not in order_words([bad, lost], PRINTED)
    assert "does not come out" in order_words([calm], PRINTED)
    assert "does not come out" in order_words([followed("hough", 1.0, 2.0, 1.5)], PRINTED)


def test_the_energies_are_compared_by_scene_beside_the_papers_numbers(found: dict[str, Findings]) -> None:
    by_scene, by_approach = found["edge-energies"].tables
    rows = {str(row[0]): dict(zip(by_scene.columns, row, strict=True)) for row in by_scene.rows}
    assert rows[FLAT]["paper's 1"] == 30.9
    assert {row["paper's 2"] for name, row in rows.items() if name not in (FLAT, HOUGH)} == {7.3}
    each = [dict(zip(by_approach.columns, row, strict=True)) for row in by_approach.rows]
    for method, row in rows.items():
        pooled = np.sqrt(np.mean([float(str(one[method])) ** 2 for one in each]))
        assert float(str(row["all"])) == pytest.approx(pooled)
        assert float(str(row["day"])) == pytest.approx(float(str(each[0][method])))
    assert [note for note in by_scene.notes if "table 1" in note] == list(by_scene.notes)


def test_a_runway_is_cut_out_where_it_is() -> None:
    """Expected: it fills most of the panel, a line through it is where it was seen, and colours are explained."""
    image = np.zeros((480, 640, 3), np.uint8)
    image[200:301, 299:302] = 255
    rows = np.array([200.0, 300.0])
    wanted = np.array([290.0, 280.0, 310.0, 320.0])
    shown = panel(image, wanted, rows, [((0, 0, 255), np.full(4, 300.0))], "a name")
    assert shown.shape == (PANEL_PX[1], PANEL_PX[0], 3)
    red = np.argwhere((shown[:, :, 2] > 200) & (shown[:, :, 0] < 100))
    white = np.argwhere((shown[:270] > 100).all(axis=2))
    assert np.ptp(red[:, 0]) > 0.6 * PANEL_PX[1]
    assert np.ptp(white[:, 0]) == pytest.approx(np.ptp(red[:, 0]), abs=8)
    assert white[:, 1].mean() == pytest.approx(red[:, 1].mean(), abs=2.0)
    # near the picture's border nothing from outside of it is shown
    assert panel(np.full_like(image, 90), wanted - 285.0, rows + 170.0, [], "")[:270].min() == 90
    whole = sheet([[shown, shown], [shown]], [((0, 0, 255), "truth")])
    assert whole.shape[1] == 2 * PANEL_PX[0]
    assert np.array_equal(whole[-PANEL_PX[1] :, : PANEL_PX[0]], shown)
    assert (whole[: -2 * PANEL_PX[1]].reshape(-1, 3) == (0, 0, 255)).all(axis=1).sum() > 20


def test_each_round_leads_astray_as_far_as_the_filter_predicts(found: dict[str, Findings]) -> None:
    """Expected: in every pass the runway corrects the filter, and before it the filter's covariance is consistent."""
    (table,) = found["passes"].tables
    rows = [dict(zip(table.columns, row, strict=True)) for row in table.rows]
    assert [row["pass"] for row in rows] == ["pass 1", "pass 2"]
    assert rows[0]["astray m"] is None
    for row in rows:
        assert int(str(row["pictures"])) > 50
        assert all(float(str(row[f"{axis} m"])) < 2.0 for axis in "xyz")
        assert float(str(row["steps, most"])) >= float(str(row["steps, median"])) >= 1.0
    after = rows[1]
    assert float(str(after["without runway s"])) > 20.0
    astray, sigma = (float(str(after[name])) for name in ("astray m", "1σ m"))
    assert astray < 4.0 * sigma
    # measured on these 43.5 s without runway: 13.5 m astray and 9.4 m stated, which bounds both without each other
    assert astray < 4.0 * 9.4
    assert 9.4 / 2.0 < sigma < 2.0 * 9.4
    # chi-square of 6 degrees of freedom, 99.99 %
    assert float(str(after["NEES before (6)"])) < 27.9
    assert float(str(after["NEES before (6)"])) > chi2.ppf(1e-4, 6)
    assert astray > 3.0 * float(str(after["y m"]))
