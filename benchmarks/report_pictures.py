"""The pictures of the report in the documentation, taken by Chromium from a report that has been made.

    groundstation replay recordings/landing-1 --out out/landing-1
    python -m benchmarks.report_pictures out/landing-1/report.html docs/images

Writes `report.png` (1440 px wide) and `report-phone.png` (390 px), the page's upper part.
"""

import argparse
import base64
import io
import sys
import tempfile
from pathlib import Path

from PIL import Image

from tests.browser import browser

# name, width and height of the window
PICTURES = (("report.png", 1440, 1500), ("report-phone.png", 390, 1560))
COLOURS = 256


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("report", type=Path, help="a report.html")
    parser.add_argument("folder", type=Path, help="where the pictures go")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as profile, browser(Path(profile)) as page:
        for name, width_px, height_px in PICTURES:
            page.ask("Emulation.setScrollbarsHidden", hidden=True)
            page.show(options.report.resolve().as_uri(), width_px, height_px)
            shot = base64.b64decode(page.ask("Page.captureScreenshot", format="png")["data"])
            picture = Image.open(io.BytesIO(shot)).convert("RGB")
            picture.quantize(COLOURS, Image.Quantize.MEDIANCUT).save(options.folder / name, optimize=True)
            print(f"wrote {options.folder / name}, {picture.size[0]}×{picture.size[1]} px")
    return 0


if __name__ == "__main__":
    sys.exit(main())
