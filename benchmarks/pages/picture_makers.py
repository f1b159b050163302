"""What makes each file of docs/images: functions of a workshop and of the path to write."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import landing_animation
import report_pictures
import touchdown_sheet
from landing_flights.tracked_approach import prior_landing, track
from PIL import Image

from groundstation.viewer.viewer_process import serve_recording, viewer_environment
from pages.passages import ROOT
from pages.workshop import Workshop

_SIMULATE = "groundstation simulate --out flights/one --wind 4 --seed 7"
_REPLAY = "groundstation replay flights/one --out out/one"
_LANDING = "groundstation replay recordings/landing-1 --out out/landing-1"
_LIVE = "groundstation live --simulate --out out/live --for 40"
# the frame of the left camera that shows the simulated landing: before trees, 150 m away
_FRAME = 185
_SEED = 3
# in a window of a browser: Rerun draws with WebGL, here without a graphics card
_SOFTWARE = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")
_SCREEN = (1600, 900)
# the viewer loads, and decodes the video up to the time that is shown
_LOADED_S = 40.0


def landing(shop: Workshop, path: Path) -> None:
    """Write the animation of the bundled landing."""
    landing_animation.main(path)


def report(shop: Workshop, path: Path) -> None:
    """Write the report of the bundled landing on a desktop."""
    shop.run(_LANDING)
    report_pictures.take(shop.folder / "out" / "landing-1" / "report.html", path, 1440, 1500)


def report_on_a_phone(shop: Workshop, path: Path) -> None:
    """Write the same on a phone."""
    shop.run(_LANDING)
    report_pictures.take(shop.folder / "out" / "landing-1" / "report.html", path, 390, 1560)


def first_report(shop: Workshop, path: Path) -> None:
    """Write the report of the simulated landing."""
    _first_flight(shop)
    report_pictures.take(shop.folder / "out" / "one" / "report.html", path, 1100, 900)


def site(shop: Workshop, path: Path) -> None:
    """Write a page of the documentation's site."""
    built = shop.folder / "site"
    command = [sys.executable, "-m", "sphinx", "--quiet", "--doctree-dir", str(shop.folder / "doctrees")]
    subprocess.run([*command, str(ROOT / "docs"), str(built)], check=True)
    report_pictures.take(built / "first-flight.html", path, 1440, 900)


def simulated(shop: Workshop, path: Path) -> None:
    """Write a picture of the simulated landing."""
    shop.run(_SIMULATE)
    video = cv2.VideoCapture(str(shop.folder / "flights" / "one" / "left.avi"))
    video.set(cv2.CAP_PROP_POS_FRAMES, _FRAME)
    decoded, picture = video.read()
    video.release()
    if not decoded:
        raise RuntimeError(f"left.avi: frame {_FRAME} cannot be decoded")
    small = cv2.resize(picture, (640, 480), interpolation=cv2.INTER_AREA)
    report_pictures.save_with_palette(Image.fromarray(cv2.cvtColor(small, cv2.COLOR_BGR2RGB)), path)


def plan(shop: Workshop, path: Path) -> None:
    """Write the plan of the example's site."""
    shop.run("groundstation plan docs/site-example.toml --out out/plan")
    picture = Image.open(shop.folder / "out" / "plan" / "plan.png").convert("RGB")
    report_pictures.save_with_palette(picture, path)


def first_view(shop: Workshop, path: Path) -> None:
    """Write the simulated landing in Rerun."""
    _first_flight(shop)
    _in_rerun(shop.folder / "out" / "one" / "session.rrd", 12.0, path)


def rerun(shop: Workshop, path: Path) -> None:
    """Write the bundled landing in Rerun."""
    shop.run(_LANDING)
    _in_rerun(shop.folder / "out" / "landing-1" / "session.rrd", 25.0, path)


def rerun_two_runs(shop: Workshop, path: Path) -> None:
    """Write the bundled landing with two tunings."""
    shop.run(_LANDING)
    shop.run("groundstation replay recordings/landing-1 --config docs/lively.toml --out out/lively")
    shop.run("groundstation view out/landing-1 out/lively --save out/both.rrd")
    _in_rerun(shop.folder / "out" / "both.rrd", 25.0, path)


def rerun_in_browser(shop: Workshop, path: Path) -> None:
    """Write the bundled landing in a browser with a light theme."""
    shop.run(_LANDING)
    address, server = serve_recording(shop.folder / "out" / "landing-1" / "session.rrd", viewer_environment({}))
    try:
        report_pictures.take_address(address, path, *_SCREEN, after_s=_LOADED_S, flags=_SOFTWARE)
    finally:
        server.terminate()
        server.wait()


def rerun_recording(shop: Workshop, path: Path) -> None:
    """Write a live run's recording, replayed."""
    shop.run(_LIVE)
    shop.run("groundstation replay out/live/flight.mcap --out out/again")
    _in_rerun(shop.folder / "out" / "again" / "session.rrd", 35.5, path)


def rerun_mcap(shop: Workshop, path: Path) -> None:
    """Write a live run's recording, opened by Rerun alone."""
    shop.run(_LIVE)
    _in_rerun(shop.folder / "out" / "live" / "flight.mcap", 35.5, path)


def live(shop: Workshop, path: Path) -> None:
    """Write the operator's screen of a simulated range in a browser, 30 s after its start."""
    with _live_page(shop.folder / "out" / "screen") as address:
        report_pictures.take_address(address, path, *_SCREEN, after_s=30.0, flags=_SOFTWARE)


def onboard_pose(shop: Workshop, path: Path) -> None:
    """Write the four pictures of a nose camera's approach below the folder of the path; the path is one of them."""
    if not path.exists():
        # the first of the flights in docs/notes/onboard.md
        _benchmark("onboard_pose.py", "--only", "flight", "--runs", "1", "--seed", "31", "--figures", str(path.parent))


def integrity_stanford(shop: Workshop, path: Path) -> None:
    """Write the Stanford diagram of the study's approaches."""
    _benchmark("integrity_study.py", "diagram", "--figure", str(path))


def touchdown(shop: Workshop, path: Path) -> None:
    """Write a landing and its ellipses."""
    touchdown_sheet.draw(track(prior_landing(_SEED), _SEED), path)


def _first_flight(shop: Workshop) -> None:
    shop.run(_SIMULATE)
    shop.run(_REPLAY)


def _benchmark(name: str, *arguments: str) -> None:
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    subprocess.run([sys.executable, str(ROOT / "benchmarks" / name), *arguments], check=True, env=environment)


def _in_rerun(recording: Path, seconds: float, path: Path) -> None:
    """Write what Rerun's viewer shows, by the program on docs/rerun.md."""
    page = (ROOT / "docs" / "rerun.md").read_text(encoding="utf-8")
    programs = re.findall(r"^python - out/session\.rrd .*<<'EOF'\n(.*?)^EOF$", page, re.MULTILINE | re.DOTALL)
    if len(programs) != 1:
        raise RuntimeError(f"docs/rerun.md: {len(programs)} programs that write a picture; wanted one")
    subprocess.run([sys.executable, "-c", programs[0], str(recording), f"{seconds:g}", str(path)], check=True)
    picture = Image.open(path).convert("RGB").resize(_SCREEN, Image.Resampling.LANCZOS)
    # lines of a pixel in colours of their own are lost in a median cut
    picture.quantize(report_pictures.COLOURS, Image.Quantize.FASTOCTREE).save(path, optimize=True)


@contextmanager
def _live_page(out: Path) -> Iterator[str]:
    """Run a simulated range whose screen is served to browsers; yields the address that it prints."""
    shutil.rmtree(out, ignore_errors=True)
    out.parent.mkdir(exist_ok=True)
    command = [sys.executable, "-m", "groundstation", "live", "--simulate", "--out", str(out), "--for", "90", "--web"]
    log = out.with_suffix(".txt")
    # the address is written at once, not when a buffer is full
    environment = os.environ | {"PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1"}
    with (
        log.open("w") as stream,
        subprocess.Popen(command, stdout=stream, stderr=subprocess.STDOUT, env=environment) as process,
    ):
        try:
            while not (found := re.search(r"http://\S+", log.read_text())):
                if process.poll() is not None:
                    raise RuntimeError(f"live ended: {log.read_text()[-500:]}")
                time.sleep(0.2)
            yield found[0]
        finally:
            process.send_signal(signal.SIGINT)
