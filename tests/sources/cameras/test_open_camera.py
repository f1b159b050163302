"""Cameras by URL: an error in one is reported in one line, before anything is opened."""

import importlib
import types
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.sources.cameras.camera import CameraError, CameraSettings
from groundstation.sources.cameras.open_camera import open_camera, parse_camera_url


def opened(url: str, environ: dict[str, str] | None = None) -> None:
    open_camera(url, CameraSettings(), clock=lambda: 0.0, on_event=lambda event: None, environ=environ or {})


@pytest.mark.parametrize(
    ("url", "scheme", "place", "options"),
    [
        ("genicam:12345?cti=/a/b.cti&cti=/c.cti", "genicam", "12345", {"cti": ["/a/b.cti", "/c.cti"]}),
        ("genicam:My%20camera", "genicam", "My camera", {}),
        ("GIGE:192.168.1.10?packet=1400", "gige", "192.168.1.10", {"packet": ["1400"]}),
        ("gige://192.168.1.10", "gige", "192.168.1.10", {}),
        ("opencv:0", "opencv", "0", {}),
        ("opencv:/dev/video2", "opencv", "/dev/video2", {}),
        ("rtsp://u:p@host:554/a?b=c", "rtsp", "rtsp://u:p@host:554/a?b=c", {}),
        ("file:what?.mp4", "file", "what?.mp4", {}),
        ("file:///tmp/a%20b.mp4", "file", "/tmp/a b.mp4", {}),
    ],
)
def test_urls_are_taken_apart(url: str, scheme: str, place: str, options: dict[str, list[str]]) -> None:
    got = parse_camera_url(url)
    assert (got.scheme, got.place, dict(got.options)) == (scheme, place, options)


@pytest.mark.parametrize(
    ("url", "complaint"),
    [
        ("", "wanted genicam:SERIAL"),
        ("0", "wanted genicam:SERIAL"),
        ("basler:1", "got 'basler:1'; wanted genicam:SERIAL"),
        ("gige:", "wanted a place behind gige:"),
        ("gige:camera-left", "got 'camera-left'; wanted an IPv4 address"),
        ("gige:1.2.3.4?packet=9", "got '9'; wanted 576 to 65535 bytes"),
        ("gige:1.2.3.4?mtu=9", "got option 'mtu'; wanted packet"),
        ("gige:1.2.3.4?packet", "wanted KEY=VALUE"),
        ("genicam:1?cti=/no/such.cti", "/no/such.cti: got no such file"),
        ("genicam:1", "got no GenTL producer; wanted .cti=FILE, or GENICAM_GENTL64_PATH"),
        ("rtsp:camera", "wanted rtsp://HOST"),
        ("file:/no/such.mp4", "got no such file; wanted a video"),
    ],
)
def test_errors_in_a_url_are_reported_at_once(url: str, complaint: str) -> None:
    for extra in ("viva_genicam", "harvesters.core"):
        pytest.importorskip(extra)
    with pytest.raises(CameraError, match=complaint) as error:
        opened(url)
    assert "\n" not in str(error.value)


@given(st.text(max_size=40))
def test_any_text_is_a_url_or_a_project_error(text: str) -> None:
    try:
        place = parse_camera_url(text).place
    except CameraError:
        return
    assert place


@pytest.mark.parametrize(
    ("url", "library", "extra"),
    [("gige:1.2.3.4", "viva-genicam", "gige"), ("genicam:1", "harvesters", "genicam")],
)
def test_a_missing_extra_is_named(url: str, library: str, extra: str, monkeypatch: pytest.MonkeyPatch) -> None:
    real = importlib.import_module

    def without(name: str) -> types.ModuleType:
        if name.split(".")[0] in ("viva_genicam", "harvesters"):
            raise ModuleNotFoundError(name)
        return real(name)

    monkeypatch.setattr(importlib, "import_module", without)
    with pytest.raises(CameraError, match=rf"got no {library}; wanted it installed: pip install .*\[{extra}\]"):
        opened(url)


def test_producers_are_searched_for_on_gentls_path(tmp_path: Path) -> None:
    pytest.importorskip("harvesters.core")
    (tmp_path / "empty").mkdir()
    with pytest.raises(CameraError, match="got no GenTL producer"):
        opened("genicam:1", {"GENICAM_GENTL64_PATH": str(tmp_path / "empty")})
    (tmp_path / "a.cti").touch()
    opened("genicam:1", {"GENICAM_GENTL64_PATH": f"{tmp_path / 'empty'}:{tmp_path}"})
