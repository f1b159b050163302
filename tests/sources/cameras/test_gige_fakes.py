"""GigE Vision against independent cameras: two of Aravis, packets lost, pulled, put back; and viva-genicam's own.

They run in a network namespace of their own, so that nothing else answers and two can have the same port.
"""

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.peers import absent

pytest.importorskip("viva_genicam", reason="extra gige is not installed")

ROOT = Path(__file__).resolve().parents[3]
NAMESPACE = ["unshare", "--map-root-user", "--net", "sh", "-c"]
LOOPBACK = "ip link set lo up && ip addr add 127.0.0.2/8 dev lo"


def in_namespace(command: str, timeout_s: float = 120.0) -> str:
    """Return what a command prints, run where only a loopback is."""
    for program in ("unshare", "ip"):
        if shutil.which(program) is None:
            pytest.skip(f"{program} is not installed: no network of its own for the fake cameras")
    if subprocess.run([*NAMESPACE, LOOPBACK], capture_output=True, check=False).returncode:
        pytest.skip("this machine allows no network namespaces for the fake cameras")
    done = subprocess.run(
        [*NAMESPACE, f"{LOOPBACK} && exec {command}"],
        capture_output=True,
        text=True,
        timeout=timeout_s,
        cwd=ROOT,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def scenario(name: str) -> dict[str, Any]:
    module = "tests.sources.cameras.aravis_scenarios" if name != "viva" else "tests.sources.cameras.viva_scenario"
    if name != "viva" and shutil.which("arv-fake-gv-camera-0.8") is None:
        absent("aravis", "apt install aravis-tools")
    result: dict[str, Any] = json.loads(in_namespace(f"{sys.executable} -m {module} {name}").splitlines()[-1])
    return result


def test_two_cameras_deliver_raw_colours_together() -> None:
    """Both at 1280 × 960 with the requested settings; their stamps are steadier than the arrivals."""
    for side, camera in scenario("two").items():
        assert camera["read_back"] == {
            "serial": "GV01" if side == "left" else "GV02",
            "exposure_s": 0.004,
            "gain": 3.0,
            "roi_px": [16, 8, 1280, 960],
            "pixel_format": "BayerRG8",
            "rate_hz": pytest.approx(25.0, abs=0.1),
            "trigger": "off",
        }
        counts = camera["counts"]
        assert camera["size_px"] == [1280, 960]
        assert camera["frames"] >= 20
        assert camera["indices_rise"]
        # every frame that the camera sent is accounted for
        assert counts["frames"] + counts["incomplete"] + counts["lost"] >= camera["last_index"]
        # the fake stamps by the wall clock: what is left is the shortest way to here, and what the fit adds
        off_ms, scatter_ms = camera["stamp_error_ms"]
        assert off_ms > -1.0
        assert scatter_ms < max(camera["arrival_error_ms"][1], 0.1)


def test_lost_packets_are_counted_and_only_whole_pictures_are_handed_on() -> None:
    camera = scenario("loss")["left"]
    assert camera["counts"]["incomplete"] >= 5
    assert camera["counts"]["reconnects"] == 0
    assert camera["frames"] >= 5
    assert camera["whole"]
    assert camera["indices_rise"]


def test_a_camera_unplugged_and_plugged_in_twice_returns_twice() -> None:
    """The other one continues meanwhile; no reader is blocked, otherwise this would not end."""
    result = scenario("unplugged")
    left, right = result["left"], result["right"]
    assert left["counts"]["reconnects"] >= 2
    assert set(left["openings"]) >= {0, 1, 2}
    assert left["indices_rise"]
    assert left["whole"]
    assert left["events"][0] == "opened"
    assert left["events"].count("not opened") >= 2
    assert any("got no answer" in text for text in left["texts"])
    assert right["frames"] > left["frames"]


def test_what_a_camera_refuses_is_one_line() -> None:
    reported = scenario("refused")
    wanted = {
        "exposure": "exposure in µs: got a refusal of ExposureTimeAbs",
        "format": "got a refusal of PixelFormat",
        "region": "got a refusal of Width",
        "trigger": "got a refusal of TriggerSource",
        "absent": "GigE cameras that answer: 127.0.0.1",
        "busy": "wanted a camera that no other program controls",
    }
    for name, text in wanted.items():
        assert text in reported[name]
        assert reported[name].startswith("gige:127.0.0.")
        assert "\n" not in reported[name]
    # and the owner of the camera is not disturbed
    assert int(reported["frames"]) > 0


def test_each_raw_pattern_has_the_colours_that_the_camera_gives_itself() -> None:
    """Red, green and blue follow each other along its gradient; a pattern taken for another would exchange two.

    Aravis 0.8.26 has blue in the first pixel of what it calls BayerRG8, and red in BayerBG8's: against the names'
    convention, and against its own RGB8, which its BayerGR8 and BayerGB8 agree with.
    """
    lags = scenario("colours")
    green, red = lags["RGB8"]
    assert min(abs(green), abs(red), abs(red - green)) > 0.3
    for pattern in ("BayerGR8", "BayerGB8"):
        assert lags[pattern] == pytest.approx([green, red], abs=0.1), pattern
    for pattern in ("BayerRG8", "BayerBG8"):
        assert lags[pattern] == pytest.approx([-green, -red], abs=0.1), pattern


def test_lost_packets_are_requested_again_where_the_camera_can() -> None:
    """viva-genicam's fake loses the given packets: sent again they complete a frame, otherwise it is incomplete."""
    result = scenario("viva")
    assert result["resent"]["counts"]["incomplete"] == 0
    assert result["resent"]["counts"]["lost"] == 0
    assert result["resent"]["frames"] >= 10
    assert result["not resent"]["counts"]["incomplete"] == 3
    assert result["resent"]["device_clock"]
    assert result["resent"]["pattern"] == "BayerRG8"


def test_the_command_line_lists_and_shows_them() -> None:
    if shutil.which("arv-fake-gv-camera-0.8") is None:
        absent("aravis", "apt install aravis-tools")
    groundstation = f"{sys.executable} -m groundstation cameras"
    script = (
        "sh -c 'arv-fake-gv-camera-0.8 -i 127.0.0.1 -s GV01 & sleep 1;"
        f" {groundstation} list 2>/dev/null; echo {{}};"
        f" {groundstation} show gige:127.0.0.1 --seconds 2 --exposure-ms 2 --format BayerGR8; kill $!'"
    )
    printed = in_namespace(script)
    assert "gige:127.0.0.1  Aravis Fake" in printed
    assert "exposure      2.000 ms" in printed
    assert "pixel format  BayerGR8" in printed
    assert "drift" in printed
    assert " complete, " in printed
