"""Lines of receivers: JSON of dump1090 and readsb, SBS, and what is none; paths from them; a receiver's port kept."""

import errno
import json
import socket
import threading
from pathlib import Path
from typing import cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibration.sky.adsb import AdsbReport, as_json, by_aircraft, read_adsb, reports_of
from calibration.sky.flight_path import fit_path, geometric_height, runway_positions
from calibration.stars.sky import ObservingSite
from groundstation.cli import adsb_receiver
from groundstation.cli.adsb_lines import connection_lines, file_lines
from groundstation.cli.adsb_receiver import AdsbReceiver
from groundstation.cli.main import main
from groundstation.errors import InputError
from groundstation.geometry.geodesy import ecef_from_enu, geodetic_from_ecef
from tests.live.test_heads import until

SITE = ObservingSite(lat_deg=47.0, lon_deg=8.0, height_m=500.0, y_axis_azimuth_deg=0.0, pressure_hpa=960.0, air_c=11.75)
READSB = '{"now":1779364800.25,"hex":"3C6444","lat":47.25,"lon":8.5,"alt_baro":36000,"alt_geom":36725,"seen_pos":1.25}'
DUMP1090 = (
    '{"now": 1779364801.0, "messages": 5, "aircraft": [{"hex":"4b1618","lat":47.1,"lon":8.1,"alt_baro":3000,'
    '"seen_pos":0.5},{"hex":"4b1619","alt_baro":"ground"},{"hex":"4b1620","lat":47.2,"lon":8.2,"altitude":9000}]}'
)
SBS = "MSG,3,1,1,4CA2D6,1,2026/05/21,12:00:02.500,2026/05/21,12:00:02.600,,35000,,,47.5,7.5,,,0,0,0,0"


def test_each_receiver_s_lines_are_read(tmp_path: Path) -> None:
    path = tmp_path / "adsb.jsonl"
    path.write_text("\n".join([READSB, DUMP1090, SBS, "MSG,8,1,1,4CA2D6", "", "{", "[1]", READSB]))
    found = read_adsb(path)
    assert sorted(found) == ["3c6444", "4b1618", "4b1620", "4ca2d6"]
    (report,) = found["3c6444"]
    assert (report.t_s, report.lat_deg, report.geometric) == (1779364799.0, 47.25, True)
    assert report.height_m == pytest.approx(36725 * 0.3048)
    assert not found["4b1618"][0].geometric
    assert found["4b1618"][0].t_s == 1779364800.5
    (sbs,) = found["4ca2d6"]
    assert sbs.t_s == 1779364802.5
    assert sbs.height_m == pytest.approx(10668.0)


def test_a_position_repeated_counts_once_and_lines_written_are_read_again(tmp_path: Path) -> None:
    """Expected: aircraft.json each second repeats a position with another age; the first time that it came stays."""
    lines = [READSB, READSB.replace("1779364800.25", "1779364801.25").replace("1.25}", "2.0}")]
    found = by_aircraft(reports_of(lines))
    assert [r.t_s for r in found["3c6444"]] == [1779364799.0]
    (again,) = reports_of([as_json(found["3c6444"][0])])
    assert again.t_s == 1779364799.0
    assert again.height_m == pytest.approx(found["3c6444"][0].height_m, abs=0.05)


def test_a_number_too_large_for_a_float_is_none() -> None:
    assert list(reports_of([READSB.replace("47.25", "1" + "0" * 400)])) == []


def test_a_receiver_s_thread_that_fails_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(_: object) -> None:
        raise ArithmeticError("odd")

    monkeypatch.setattr(adsb_receiver, "reports_of", broken)
    (tmp_path / "lines").write_text(READSB + "\n")
    with AdsbReceiver(f"file:{tmp_path}/lines", tmp_path / "kept") as receiver:
        assert until(lambda: receiver_fault(receiver) != "", 5.0)
        assert "got a line that cannot be read (ArithmeticError: odd); wanted" in receiver_fault(receiver)


def receiver_fault(receiver: AdsbReceiver) -> str:
    try:
        return receiver.ended()
    except InputError as fault:
        return str(fault)


class FailingConnection:
    """A connection that gives one part, and then fails by what it is told."""

    def __init__(self, fault: OSError) -> None:
        self.options: set[tuple[int, int]] = set()
        self._fault, self._parts = fault, [READSB.encode() + b"\n"]

    def settimeout(self, seconds: float) -> None:
        assert seconds > 0.0

    def setsockopt(self, level: int, option: int, value: int) -> None:
        self.options.add((level, option))
        assert value > 0

    def recv(self, size: int) -> bytes:
        assert size > 0
        if self._parts:
            return self._parts.pop()
        raise self._fault


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (OSError(errno.EHOSTUNREACH, "No route to host"), "No route to host"),
        (TimeoutError(errno.ETIMEDOUT, "Timed out"), "Timed out"),
    ],
)
def test_a_network_that_fails_or_a_receiver_that_is_gone_ends_the_connection(fault: OSError, words: str) -> None:
    connection = FailingConnection(fault)
    lines = connection_lines(cast("socket.socket", connection), threading.Event())
    assert next(lines) == READSB
    assert (socket.SOL_SOCKET, socket.SO_KEEPALIVE) in connection.options
    with pytest.raises(ConnectionError, match=words):
        next(lines)


def test_a_file_is_read_in_parts(tmp_path: Path) -> None:
    """Expected: the lines of 2.5 MB one after the other, none lost or cut where parts of 1 MB meet."""
    path = tmp_path / "lines"
    wanted = [f"{k:06d} {'x' * 92}" for k in range(25_000)]
    path.write_text("\n".join(wanted) + "\n")
    stop = threading.Event()
    lines = file_lines(path, stop)
    assert [next(lines) for _ in wanted] == wanted
    stop.set()


def test_a_file_that_would_feed_itself_is_refused(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.jsonl").write_text(READSB + "\n")
    assert main(["calibrate", "sky", "--receive", "file:a.jsonl", "--keep", str(tmp_path / "a.jsonl")]) == 2
    assert "--receive: got 'file:a.jsonl'; wanted another file" in capsys.readouterr().err


def test_a_file_without_positions_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("hello\n{}\n")
    with pytest.raises(InputError, match=r"a\.txt: got no aircraft's position; wanted lines of dump1090 or readsb"):
        read_adsb(tmp_path / "a.txt")
    with pytest.raises(InputError, match="No such file"):
        read_adsb(tmp_path / "b.txt")


def test_a_file_without_line_ends_is_not_read_to_its_end(tmp_path: Path) -> None:
    """Expected: refused after the longest line; of nothing but zeros."""
    with (tmp_path / "a.txt").open("wb") as file:
        file.truncate(20 * 2**30)
    with pytest.raises(InputError, match=r"a\.txt: got a line of more than 4000000 characters"):
        read_adsb(tmp_path / "a.txt")


KEYS = st.sampled_from(["now", "hex", "lat", "lon", "alt_geom", "aircraft", "seen_pos"])
JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner, max_size=7),
    max_leaves=12,
)
FIELDS = st.lists(st.text(), max_size=23).map(lambda fields: "MSG,3," + ",".join(fields))


@settings(max_examples=40)
@given(st.lists(st.text() | JSON.map(json.dumps) | FIELDS, max_size=4))
def test_any_text_is_a_receiver_s(lines: list[str]) -> None:
    for report in reports_of(lines):
        assert np.isfinite([report.t_s, report.lat_deg, report.lon_deg, report.height_m]).all()


def test_pressure_altitude_becomes_a_height_in_the_site_s_air() -> None:
    """Expected: in the standard atmosphere both agree; 10 K warmer air, by the same pressure below, is 3.5 % higher."""
    standard = ObservingSite(lat_deg=0.0, lon_deg=0.0, height_m=0.0, y_axis_azimuth_deg=0.0)
    assert geometric_height(10_000.0, standard) == pytest.approx(10_000.0, abs=20.0)
    warm = ObservingSite(
        lat_deg=0.0, lon_deg=0.0, height_m=0.0, y_axis_azimuth_deg=0.0, pressure_hpa=1013.25, air_c=25.0
    )
    assert geometric_height(10_000.0, warm) == pytest.approx(10_347.0, abs=5.0)


def reports(scatter_m: float, gap: tuple[float, float] = (0.0, 0.0)) -> tuple[AdsbReport, ...]:
    """Reports each second of an airliner that flies along x at 240 m/s."""
    random = np.random.default_rng(3)
    t = np.arange(-60.0, 61.0)
    t = t[(t < gap[0]) | (t >= gap[1])]
    place = np.column_stack([240.0 * t, np.full(len(t), 20_000.0), np.full(len(t), 10_000.0)])
    place += random.normal(0.0, scatter_m, place.shape)
    lat, lon, height = geodetic_from_ecef(ecef_from_enu(place, (SITE.lat_deg, SITE.lon_deg, SITE.height_m)))
    return tuple(
        AdsbReport(
            aircraft="abc",
            t_s=1e9 + float(t[k]),
            lat_deg=float(lat[k]),
            lon_deg=float(lon[k]),
            height_m=float(height[k]),
            geometric=True,
        )
        for k in range(len(t))
    )


def test_a_path_is_where_its_positions_are_and_says_how_sure_that_is() -> None:
    """Expected: 20 m of scatter on 121 positions leave a few metres; the lasting error of 30 m stays."""
    path = fit_path(reports(20.0), 1e9 - 40.0, 1e9 + 40.0, SITE)
    assert not isinstance(path, str)
    t = np.linspace(-40.0, 40.0, 9)
    place, deviations = path.at(t)
    assert np.abs(place - np.column_stack([240.0 * t, np.full(9, 2e4), np.full(9, 1e4)])).max() < 25.0
    assert path.report_m == pytest.approx(20.0, rel=0.15)
    sigma = np.sqrt(np.sum(deviations**2, axis=2))
    # along its way its own latency of 0.3 s, 72 m, besides
    assert sigma[:, 0] == pytest.approx(np.full(9, np.hypot(30.0, 72.0)), rel=0.05)
    assert sigma[:, 1] == pytest.approx(np.full(9, 31.5), rel=0.1)
    velocity, _ = path.at(t, derivative=1)
    assert velocity[:, 0] == pytest.approx(np.full(9, 240.0), abs=3.0)


def test_positions_that_are_too_few_or_have_a_gap_are_passed_over() -> None:
    few = fit_path(reports(0.0)[:20], 1e9 - 40.0, 1e9 + 40.0, SITE)
    assert few == "positions with a gap of more than 12 s around its pictures"
    assert "at least 8 are needed" in str(fit_path(reports(0.0)[:4], 1e9 - 40.0, 1e9 + 40.0, SITE))
    assert "a gap" in str(fit_path(reports(0.0, (-10.0, 10.0)), 1e9 - 40.0, 1e9 + 40.0, SITE))


def test_places_are_those_of_the_runway_frame() -> None:
    place = runway_positions(reports(0.0)[:2], SITE)
    assert place[0] == pytest.approx([-14_400.0, 20_000.0, 10_000.0], abs=0.01)


def test_a_receiver_s_port_is_kept_with_the_time_of_arrival(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Expected: SBS lines of any time zone become lines with this computer's time; the file is read as any other."""
    out = tmp_path / "day" / "adsb.jsonl"
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve() -> None:
            connection, _ = server.accept()
            with connection:
                for part in (SBS[:30], SBS[30:] + "\r\nMSG,1,,\r\n", READSB + "\n"):
                    connection.sendall(part.encode())

        thread = threading.Thread(target=serve)
        thread.start()
        where = f"127.0.0.1:{server.getsockname()[1]}"
        assert main(["calibrate", "sky", "--receive", where, "--keep", str(out)]) == 0
        thread.join()
    assert "kept 2 positions" in capsys.readouterr().out
    found = read_adsb(out)
    assert set(found) == {"4ca2d6", "3c6444"}
    assert found["4ca2d6"][0].t_s > 1.78e9
    assert main(["calibrate", "sky", "--receive", "127.0.0.1:1", "--keep", str(out)]) == 1
    assert "wanted a receiver's port of lines" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ([], "got no --from, --rig, --site, --out"),
        (["--receive", "localhost:30003"], "--receive: got no --keep"),
        (["--receive", "30003", "--keep", "a.jsonl"], "wanted HOST:PORT"),
        (["--receive", "h:99999", "--keep", "a.jsonl"], "wanted HOST:PORT"),
    ],
)
def test_arguments_that_cannot_be_are_usage_errors(tmp_path, monkeypatch, capsys, arguments, complaint) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["calibrate", "sky", *arguments]) == 2
    assert complaint in capsys.readouterr().err
