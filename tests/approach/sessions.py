"""The bundled landing as a session of pixels, with a place on Earth: replayed in a second."""

import csv
import shutil
from pathlib import Path

import numpy as np

_ROOT = Path(__file__).resolve().parents[2]
LANDING = _ROOT / "recordings" / "landing-1"
ORIGIN = "[origin]\nlat_deg = 47.3\nlon_deg = 8.5\nheight_m = 460.0\ny_axis_azimuth_deg = 30.0\n"
SITE = """format = "groundstation-landing-site/1"
[runway]
threshold_m = [0.0, 150.0, 0.0]
[approach]
glide_path_deg = 3.5
aim_past_threshold_m = 40.0
"""


def pixel_session(folder: Path, *, origin: str = ORIGIN) -> Path:
    """Write the landing's true pixels with 0.5 px of noise as a session, and a site next to it; returns its folder."""
    session = folder / "session"
    session.mkdir(parents=True)
    for name in ("frames.csv", "ptu.csv", "rig.toml", "dgps.csv"):
        shutil.copy(LANDING / name, session)
    lines = (LANDING / "session.toml").read_text().split("[[phase]]")[0].splitlines()
    # a session's own key origin is where it comes from, in words
    kept = [line for line in lines if not line.startswith("origin =")]
    (session / "session.toml").write_text("\n".join([*kept, origin]))
    noise = np.random.default_rng(5)
    with (LANDING / "truth.csv").open() as truth, (session / "detections.csv").open("w", newline="") as out:
        table = csv.writer(out)
        table.writerow(["t_s", "station", "u_px", "v_px"])
        for row in csv.DictReader(truth):
            for station in ("left", "right"):
                u, v = (float(row[f"{station}_{axis}_px"]) + noise.normal(0.0, 0.5) for axis in "uv")
                table.writerow([row["t_s"], station, f"{u:.3f}", f"{v:.3f}"])
    (folder / "landing-site.toml").write_text(SITE)
    return session
