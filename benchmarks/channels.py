"""The paper's input channel against others: accuracy with equalised S, with grey, and with the measured choice.

    python benchmarks/channels.py [SESSION …]

For each session with truth: share of pairs tracked, RMSE at y 150–250 m, and the median time of a detection.
"""

import argparse
import csv
import statistics
import tempfile
from pathlib import Path

from groundstation.replay.replay import ReplayRequest, replay

ROOT = Path(__file__).resolve().parent.parent
SETTINGS = {
    "measured choice (default)": "",
    "grey": '[detection]\nchannel = "grey"\n',
    "saturation, equalised (paper)": '[detection]\nchannel = "saturation"\nequalise = true\n',
}


def measure(session: Path, tuning: str) -> str:
    """Replay with one setting and return its line."""
    with tempfile.TemporaryDirectory() as folder:
        config = Path(folder) / "tuning.toml"
        config.write_text(tuning)
        out = Path(folder) / "out"
        result = replay(ReplayRequest(session=session, out=out, config=config, rerun=False))
        with (out / "detections.csv").open() as stream:
            elapsed = [float(r["elapsed_ms"]) for r in csv.DictReader(stream) if r["status"] == "ok"]
    summary = result.evaluation.summary
    track = summary["counts"]["track"]
    share = track["tracking"] / max(1, sum(track.values()))
    groups = summary["accuracy"].get("truth", {}).get("by_range", [])
    errors = [g["ekf"]["rmse_m"] for g in groups if g["from_m"] == 150 and g["ekf"]["rmse_m"]]
    rmse = "/".join(f"{v:.3f}" for v in errors[0]) if errors else "no estimate"
    median = f"{statistics.median(elapsed):.1f} ms" if elapsed else "–"
    return f"tracked {100 * share:5.1f} %, RMSE y 150–250 m {rmse} m, detection {median}"


def main() -> None:
    """Print one line for each session and setting."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("sessions", type=Path, nargs="*", default=[ROOT / "recordings" / "landing-1"])
    for session in parser.parse_args().sessions:
        print(session.name)
        for name, tuning in SETTINGS.items():
            print(f"  {name:32s} {measure(session, tuning)}")


if __name__ == "__main__":
    main()
