"""The site is built without a warning, and neither building nor reading it makes a network request."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.docs.pages import ROOT

_OFFLINE = """
import socket, sys
def refuse(*_, **__): raise SystemExit("the network was asked")
socket.socket.connect = socket.getaddrinfo = refuse
from sphinx.cmd.build import main
sys.exit(main(sys.argv[1:]))
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("site") / "html"
    options = ["--quiet", "--fail-on-warning", "--doctree-dir", str(out.parent / "doctrees")]
    command = [sys.executable, "-c", _OFFLINE, *options, str(ROOT / "docs"), str(out)]
    built = subprocess.run(command, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    return out


def test_every_page_is_built(site: Path) -> None:
    for page in (ROOT / "docs").rglob("*.md"):
        assert (site / page.relative_to(ROOT / "docs").with_suffix(".html")).stat().st_size > 1000, page.name


def test_readers_need_no_network(site: Path) -> None:
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        fetched = re.findall(r"<(?:script|img|iframe|source)[^>]+src=\"([^\"]+)", text)
        fetched += re.findall(r"<link[^>]+rel=\"(?:stylesheet|preload|icon)\"[^>]+href=\"([^\"]+)", text)
        assert not [url for url in fetched if "//" in url], page.name
    for sheet in site.rglob("*.css"):
        found = re.findall(r"url\(([^)]+)\)|@import ([^;]+)", sheet.read_text(encoding="utf-8"))
        assert not [url for pair in found for url in pair if "//" in url.split(",")[0] and "data:" not in url], sheet


def test_the_help_is_the_programs_own(site: Path) -> None:
    text = (site / "commands.html").read_text(encoding="utf-8")
    assert "usage: groundstation calibrate flight" in text
    assert 'id="groundstation-live"' in text
