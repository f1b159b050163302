"""How long the search of a whole picture takes, picture by picture, and what `live` leaves out with it.

    python benchmarks/search_time.py SESSION [--rate HZ] [--pictures N]

The pictures of each camera are searched one after another as if they came at a rate, without a target and without what
other cameras show. Times are the processor's, one thread. These times are then played through the queue of `live` in
virtual time: how old a pair is once it has been searched, and the share of pairs that are left out as a whole.
"""

import argparse
import itertools
import time
from collections.abc import Iterator
from pathlib import Path
from unittest.mock import patch

import cv2
import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.detection.candidate_finder import AcquisitionConfig
from groundstation.detection.config import DetectionConfig, DetectorKind
from groundstation.detection.learned_channel import ChannelMaps, LearnedChannel
from groundstation.detection.make_detector import make_finder
from groundstation.live.frame_pairing import FramePairer, LoadShedder
from groundstation.rig.rig import load_rig
from groundstation.tracking.warm_up import warm_up

LIVE_S = 60.0


def pictures(folder: Path, station: str, most: int) -> Iterator[ImageArray]:
    """Yield the first pictures of a station's video."""
    path = next(p for p in sorted(folder.glob(f"{station}.*")) if p.suffix in (".mp4", ".avi", ".mkv"))
    video = cv2.VideoCapture(str(path))
    for _ in range(most):
        known, image = video.read()
        if not known:
            return
        yield np.asarray(image, np.uint8)


def played(names: list[str], times_s: dict[str, FloatArray], rate_hz: float) -> tuple[FloatArray, float]:
    """Return the delays of searched pairs, s, and the share of those left out."""
    period = 1.0 / rate_hz
    pairing = FramePairer(names, period)
    shedding = LoadShedder(pairing, period, most=len(names) + 1)
    turns = {name: itertools.cycle(times_s[name]) for name in names}
    arrivals = [(k * period + 1e-3 * i, name) for k in range(int(LIVE_S * rate_hz)) for i, name in enumerate(names)]
    now_s, arrived, delays_s = 0.0, 0, []
    for at, (t_s, name) in enumerate(arrivals):
        now_s = max(now_s, t_s)
        while arrived < len(arrivals) and arrivals[arrived][0] <= now_s:
            arrived += 1
        if shedding.drops(name, t_s, arrived - at - 1):
            continue
        now_s += next(turns[name])
        if pairing.frame(name, t_s).closed_after:
            delays_s.append(now_s - t_s)
    return np.array(delays_s), shedding.pairs / (LIVE_S * rate_hz)


def main() -> None:
    """Search, play, and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("session", type=Path)
    parser.add_argument("--rate", type=float, default=30.0, help="pictures a second (default 30)")
    parser.add_argument("--pictures", type=int, default=60, help="of each camera (default 60)")
    arguments = parser.parse_args()
    windows: list[int] = []
    maps = LearnedChannel.maps_with_aircraft

    def counted(channel: LearnedChannel, window: ImageArray) -> ChannelMaps | None:
        windows[-1] += 1
        return maps(channel, window)

    warm_up(DetectorKind.LEARNED)
    patch.object(LearnedChannel, "maps_with_aircraft", counted).start()
    stations = load_rig(arguments.session / "rig.toml").stations
    times_s: dict[str, FloatArray] = {}
    for station in stations:
        finder = make_finder(AcquisitionConfig(), DetectionConfig(detector=DetectorKind.LEARNED), station.lens)
        taken = []
        for k, image in enumerate(pictures(arguments.session, station.name, arguments.pictures)):
            windows.append(0)
            began_s = time.process_time()
            finder.find(image, k / arguments.rate)
            taken.append(time.process_time() - began_s)
        # the first picture compiles
        times_s[station.name] = np.array(taken[1:])
        p50, p99 = 1e3 * np.percentile(times_s[station.name], (50, 99))
        w, h = station.lens.image_size_px
        print(f"{station.name}: {w} × {h} px, {len(taken)} pictures: {p50:.0f} ms, 99 % below {p99:.0f} ms")
    print(f"windows a picture: {np.median(windows):.0f}, at most {max(windows)}")
    delays_s, left_out = played([s.name for s in stations], times_s, arguments.rate)
    p50, p99 = 1e3 * np.percentile(delays_s, (50, 99))
    print(
        f"live at {arguments.rate:g} Hz, one core: a searched pair is {p50:.0f} ms old, 99 % below {p99:.0f} ms, "
        f"at most {1e3 * delays_s.max():.0f} ms; {100 * left_out:.0f} % of the pairs are left out, "
        f"{len(delays_s) / LIVE_S:.1f} a second are searched"
    )


if __name__ == "__main__":
    main()
