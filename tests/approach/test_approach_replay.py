"""A replay with a landing site, an autopilot and JSON lines: what is printed, written, sent, and when it is refused."""

import json
import math
import socket
import threading
from collections.abc import Iterator
from html import escape
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common

from groundstation.autopilot.local_frame import LocalFrame
from groundstation.cli.main import main
from groundstation.landing.landing_section import landing_section
from groundstation.session.folder import GeoOrigin
from tests.approach.sessions import ORIGIN, pixel_session
from tests.viewer.recording import Recording, documented_entities

pytestmark = pytest.mark.usefixtures("unrendered_figures")

_FRAME = LocalFrame(GeoOrigin(lat_deg=47.3, lon_deg=8.5, height_m=460.0, y_axis_azimuth_deg=30.0), 0.0)
_SETTINGS = """format = "groundstation-autopilot/1"
url = "udpout:127.0.0.1:9"
mode = "gps_input"
geoid_separation_m = 0.0
delay_s = 0.1
"""


class Listener:
    """Keeps what arrives at a UDP port."""

    def __init__(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(0.1)
        self.port = self._socket.getsockname()[1]
        self.datagrams: list[bytes] = []
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._closing.is_set():
            try:
                self.datagrams.append(self._socket.recv(65_536))
            except TimeoutError:
                continue

    def close(self) -> None:
        """Stop listening."""
        self._closing.set()
        self._thread.join()
        self._socket.close()


@pytest.fixture
def listener() -> Iterator[Listener]:
    """A UDP port."""
    found = Listener()
    yield found
    found.close()


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The bundled landing as pixels."""
    return pixel_session(tmp_path_factory.mktemp("landing"))


@pytest.fixture(scope="module")
def landed(session: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of its replay with a site."""
    out = tmp_path_factory.mktemp("out") / "results"
    site = session.parent / "landing-site.toml"
    assert main(["replay", str(session), "--out", str(out), "--site", str(site)]) == 0
    return out


def test_a_replay_with_a_site_reports_the_landing(landed: Path) -> None:
    found = json.loads((landed / "landings.json").read_text())
    assert found["format"] == "groundstation-landings/1"
    (approach,) = found["approaches"]
    assert approach["outcome"] == "landed"
    down = approach["touchdown"]
    # truth: the nose settles at its height on the wheels, 0.28 m, at 29 s, 21 m past the threshold of the site
    assert down["t_s"] == pytest.approx(29.0, abs=1.0)
    assert down["past_threshold_m"] == pytest.approx(21.0, abs=10.0)
    assert abs(down["right_m"]) < 0.5
    texts = [event["text"] for event in approach["events"]]
    assert any(text.startswith("approach: ") for text in texts)


def test_its_page_has_the_landing(landed: Path) -> None:
    """Expected: the figures of landings.json, each forecast, and what was said, without markup of its own."""
    (approach,) = json.loads((landed / "landings.json").read_text())["approaches"]
    page = (landed / "report.html").read_text(encoding="utf-8")
    section = page.split("<h2>Landings</h2>")[1].split("<h2>")[0]
    down = approach["touchdown"]
    for value, sigma, digits in (
        ("t_s", "sigma_t_s", 2),
        ("past_threshold_m", "sigma_along_m", 1),
        ("sink_m_s", "sigma_sink_m_s", 2),
    ):
        assert f"{down[value]:.{digits}f} ± {down[sigma]:.{digits}f}" in section
    assert section.count("inside") + section.count("outside") == len(approach["forecasts"]) > 0
    assert all(escape(event["text"]) in section for event in approach["events"])
    assert landing_section(()) == ""


def test_its_recording_shows_needles_advice_and_the_touchdown_foretold(landed: Path) -> None:
    recording = Recording(landed / "session.rrd")
    assert documented_entities(with_site=True) <= recording.moving.keys()
    truth_m = 0.28
    heights = np.array(recording.column("/plots/approach/height", "Scalars:scalars"))
    assert heights.shape[1] == 3
    assert np.all((heights[:, 1] < heights[:, 0]) & (heights[:, 0] < heights[:, 2]))
    # the nose ends on the wheels
    assert heights[-1, 0] == pytest.approx(truth_m, abs=0.3)
    for needle in ("centre_line", "glide_path"):
        values = np.array(recording.column(f"/plots/approach/needle/{needle}", "Scalars:scalars"))
        assert np.all(np.abs(values) <= 1.0)
    # on the centre line
    assert np.median(np.abs(recording.column("/plots/approach/needle/centre_line", "Scalars:scalars"))) < 0.3
    levels = [row[0] for row in recording.column("/status/advice", "StateChange:state")]
    assert set(levels) <= {"GO", "CAUTION", "WAVE-OFF"}
    assert all(one != other for one, other in pairwise(levels))
    outlines = [row for row in recording.column("/world/runway/touchdown", "LineStrips3D:strips") if row]
    down_m = json.loads((landed / "landings.json").read_text())["approaches"][0]["touchdown"]["past_threshold_m"]
    # the site lands towards the stations, from its threshold on: past it y falls
    along_m = 150.0 - np.array([np.mean([p[1] for p in row[0]]) for row in outlines])
    assert len(outlines) > 50
    assert abs(along_m[-1] - down_m) < 10.0


@pytest.mark.parametrize(
    ("runway", "said"),
    [
        (
            "direction_deg = 180",
            "no approach: the track never came towards the site's threshold (0, 0, 0) m, direction",
        ),
        (
            "threshold_m = [0, -800, 0]",
            "m before the site's threshold (0, -800, 0) m, direction 0°: is it that runway's?",
        ),
    ],
)
def test_a_runway_that_was_not_flown_to_is_told(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], runway: str, said: str
) -> None:
    site = tmp_path / "site.toml"
    site.write_text(f'format = "groundstation-landing-site/1"\n[runway]\n{runway}\n')
    words = ["--no-rerun", "--site", str(site), "--from", "22"]
    assert main(["replay", str(session), "--out", str(tmp_path / "out"), *words]) == 0
    assert said in capsys.readouterr().out


def _messages(datagrams: list[bytes]) -> list[Any]:
    codec = common.MAVLink(None)
    return [message for data in datagrams for message in codec.parse_buffer(data) or ()]


def test_in_real_time_it_is_sent_to_an_autopilot_and_as_json(
    session: Path, landed: Path, listener: Listener, tmp_path: Path
) -> None:
    """Expected: GPS_INPUT at its rate within the track's error of the truth; one JSON line for each pair."""
    settings = tmp_path / "autopilot.toml"
    settings.write_text(_SETTINGS)
    words = ["replay", str(session), "--out", str(tmp_path / "out"), "--no-rerun", "--realtime"]
    words += ["--from", "20", "--to", "23.5", "--autopilot", f"udpout:127.0.0.1:{listener.port}"]
    words += ["--autopilot-settings", str(settings), "--udp", f"127.0.0.1:{listener.port}"]
    assert main(words) == 0
    lines = [json.loads(d) for d in listener.datagrams if d.startswith(b"{")]
    assert len(lines) == 35
    known = [line for line in lines if line["position_runway_m"] is not None]
    assert len(known) > 25
    assert {line["format"] for line in lines} == {"groundstation-estimate/1"}
    truth = np.genfromtxt(Path("recordings/landing-1/truth.csv"), delimiter=",", names=True)
    for line in known[-10:]:
        nose = [np.interp(line["t_s"], truth["t_s"], truth[f"{axis}_m"]) for axis in "xyz"]
        sigma = np.sqrt(np.array(line["covariance"]).reshape(6, 6).diagonal()[:3])
        assert np.all(np.abs(np.array(line["position_runway_m"]) - nose) < 5.0 * sigma + 0.05)
        assert line["advice"]["level"] in ("GO", "CAUTION", "WAVE-OFF")
    sent = _messages([d for d in listener.datagrams if d[:1] == b"\xfd"])
    positions = [m for m in sent if m.get_type() == "GPS_INPUT"]
    assert positions
    assert {"HEARTBEAT", "TIMESYNC", "STATUSTEXT"} <= {m.get_type() for m in sent}
    for message in positions[-5:]:
        x, y, z = _FRAME.runway_position(1e-7 * message.lat, 1e-7 * message.lon, message.alt)
        # where on its path the aircraft was: the stamp is the host's, the place is the truth's at some moment
        k = int(np.argmin(np.abs(truth["y_m"] - y)))
        assert abs(x - truth["x_m"][k]) < 0.3
        assert abs(z - truth["z_m"][k]) < 0.5
        assert math.isclose(message.horiz_accuracy, message.hdop, rel_tol=1e-5) or message.hdop == 0.5


@pytest.mark.parametrize(
    ("words", "code", "wanted"),
    [
        (["--udp", "127.0.0.1:5005"], 2, "--realtime"),
        (["--udp", "nowhere", "--realtime"], 2, "HOST:PORT"),
        (["--autopilot", "udpout:127.0.0.1:9", "--realtime"], 2, "mode of the autopilot"),
        (["--autopilot-mode", "vision", "--realtime"], 2, "the vehicle's URL"),
        (["--autopilot", "nowhere", "--autopilot-mode", "vision", "--realtime"], 2, "udpout:HOST:PORT"),
        (["--autopilot", "udpout:127.0.0.1:9", "--autopilot-mode", "vision", "--realtime"], 1, "geoid_separation_m"),
        (["--site", "{session}/session.toml"], 1, "format"),
    ],
)
def test_what_cannot_be_is_one_line(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], code: int, wanted: str
) -> None:
    words = [word.replace("{session}", str(session)) for word in words]
    assert main(["replay", str(session), "--out", str(tmp_path / "out"), "--no-rerun", *words]) == code
    error = capsys.readouterr().err
    assert wanted in error
    assert "Traceback" not in error


def test_a_stream_without_a_place_on_earth_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = pixel_session(tmp_path, origin="")
    words = ["--realtime", "--autopilot", "udpout:127.0.0.1:9", "--autopilot-mode", "vision"]
    assert main(["replay", str(folder), "--out", str(tmp_path / "out"), "--no-rerun", *words]) == 1
    assert "[origin]" in capsys.readouterr().err
    assert "[origin]" in ORIGIN
