"""The pictures of the report in the documentation, taken by Chromium from a report that has been made.

    groundstation replay recordings/landing-1 --out out/landing-1
    python benchmarks/report_pictures.py out/landing-1/report.html docs/images

Writes `report.png` (1440 px wide) and `report-phone.png` (390 px), the page's upper part. `make pages` takes these and
the other pictures of pages in a browser.
"""

import argparse
import base64
import io
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from PIL import Image

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tests.browser import browser

# name, width and height of the window
PICTURES = (("report.png", 1440, 1500), ("report-phone.png", 390, 1560))
COLOURS = 256


def save_with_palette(picture: Image.Image, to: Path) -> None:
    """Write a picture with few colours: a median cut, and two passes that keep small coloured details apart from it."""
    picture.quantize(COLOURS, Image.Quantize.MEDIANCUT, kmeans=2).save(to, optimize=True)


def take(page: Path, to: Path, width_px: int, height_px: int) -> None:
    """Write what a browser's window of this size shows of a page, as a PNG with a palette."""
    take_address(page.resolve().as_uri(), to, width_px, height_px)


def take_address(
    address: str, to: Path, width_px: int, height_px: int, *, after_s: float = 0.0, flags: Sequence[str] = ()
) -> None:
    """Write what a browser shows at an address so long after it has loaded; ``flags`` are added to the browser's."""
    with tempfile.TemporaryDirectory() as profile, browser(Path(profile), flags) as window:
        window.ask("Emulation.setScrollbarsHidden", hidden=True)
        window.show(address, width_px, height_px)
        time.sleep(after_s)
        shot = base64.b64decode(window.ask("Page.captureScreenshot", format="png")["data"])
        picture = Image.open(io.BytesIO(shot)).convert("RGB")
        save_with_palette(picture, to)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("report", type=Path, help="a report.html")
    parser.add_argument("folder", type=Path, help="where the pictures go")
    options = parser.parse_args()
    for name, width_px, height_px in PICTURES:
        take(options.report, options.folder / name, width_px, height_px)
        print(f"wrote {options.folder / name}, {width_px}×{height_px} px")
    return 0


if __name__ == "__main__":
    sys.exit(main())
