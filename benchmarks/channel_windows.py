"""The learned channel on windows of recordings with truth: is its peak on the target, how true are outline and nose?

    python benchmarks/channel_windows.py [--weights FILE] [--draws N] [SESSION …]

Each visible frame of a session ($GROUNDSTATION_DATA or a folder) gives N windows whose middle is off the silhouette's
by up to 0.3 of its width and whose scale by 0.6 to 1.6. A window is hit where the strongest response to aircraft is on
the silhouette or within 4 px of it.
"""

import argparse
import os
from pathlib import Path

import cv2
import numpy as np

from groundstation.bank.session_truth import SessionTruth
from groundstation.detection.channel_window import channel_window
from groundstation.detection.learned_channel import LearnedChannel
from groundstation.files.channel_weights import WEIGHTS, read_weights
from groundstation.picture import as_picture
from groundstation.session import load_session
from groundstation.sources.video_file import VideoFile

ROOT = Path(__file__).resolve().parent.parent
DATA = Path(os.environ.get("GROUNDSTATION_DATA", ROOT.parent / "shared" / "data"))
NAMES = ("landing-clutter", "takeoff-away")
_NEAR_PX = 4.0


def windows_of(folder: Path, channel: LearnedChannel, draws: int) -> np.ndarray:
    """Return for each window: hit, IoU at even odds, width px, odds at the peak (n, 4)."""
    session = load_session(folder)
    truth = SessionTruth(session)
    generator = np.random.default_rng(list(folder.name.encode()))
    rows = []
    for station in session.rig.names:
        for frame in VideoFile(folder / f"{station}.mp4").frames(0, truth.pairs - 1):
            seen = truth.frame(station, frame.index)
            if seen is None or not seen.visible:
                continue
            silhouette = seen.silhouette
            width = float(silhouette.width_px)
            whole = np.zeros(frame.image.shape[:2], np.float32)
            h, w = silhouette.mask.shape
            whole[silhouette.y : silhouette.y + h, silhouette.x : silhouette.x + w] = silhouette.mask
            for _ in range(draws):
                off = generator.uniform(-0.3, 0.3, 2) * width
                span = width * float(np.exp(generator.uniform(np.log(0.6), np.log(1.6))))
                window = channel_window(as_picture(frame.image), silhouette.centre_px + off, span)
                share = channel_window(
                    as_picture(np.repeat((255 * whole).astype(np.uint8)[:, :, None], 3, axis=2)),
                    silhouette.centre_px + off,
                    span,
                )
                if window is None or share is None:
                    continue
                maps = channel.maps(window.image)
                mask = share.image[:, :, 0] >= 128
                v, u = np.unravel_index(int(np.argmax(maps.aircraft)), maps.aircraft.shape)
                far = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 5)[v, u] / window.scale
                found = maps.aircraft > 0.0
                iou = float((found & mask).sum() / max((found | mask).sum(), 1))
                rows.append((far <= _NEAR_PX, iou, width, float(maps.aircraft.max())))
    return np.array(rows, np.float64)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("sessions", nargs="*", metavar="SESSION", help=f"default: {', '.join(NAMES)}")
    parser.add_argument("--weights", type=Path, default=WEIGHTS)
    parser.add_argument("--draws", type=int, default=1, metavar="N")
    arguments = parser.parse_args()
    channel = LearnedChannel(read_weights(arguments.weights, None))
    print(f"{'session':24}{'windows':>9}{'hit':>8}{'IoU':>8}{'odds > 1':>10}")
    for name in arguments.sessions or NAMES:
        folder = DATA / name if (DATA / name).is_dir() else Path(name)
        rows = windows_of(folder, channel, arguments.draws)
        hit, odds = rows[:, 0].mean(), (rows[:, 3] > 0.0).mean()
        print(f"{folder.name:24}{len(rows):9d}{hit:8.3f}{np.median(rows[:, 1]):8.3f}{odds:10.3f}", flush=True)


if __name__ == "__main__":
    main()
