"""Cost of the Rerun recording for each stereo pair, and whether its memory stays constant.

Run from the repository's root: ``python benchmarks/rerun_sink.py [laps]``. Reports are synthetic, made from the
bundled landing's truth; a lap has 332 pairs. Only the sink's own calls are timed.
"""

import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import rerun as rr

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from groundstation.viewer.rerun_sink import RerunSink, VideoAsset  # noqa: E402
from tests.viewer.synthetic import STATIONS, Landing  # noqa: E402


def _peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def main() -> None:
    laps = int(sys.argv[1]) if len(sys.argv) > 1 else 10
    landing = Landing(ROOT / "recordings" / "landing-1", laps=laps)
    videos = {}
    for name in STATIONS:
        path = landing.folder / f"{name}.mp4"
        once = rr.AssetVideo(path=path).read_frame_timestamps_nanos()
        videos[name] = VideoAsset(path=path, frame_timestamps_ns=np.tile(once, laps))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "session.rrd"
        start = time.perf_counter()
        sink = RerunSink(path, landing.rig, session_name="benchmark", media=videos)
        opened = time.perf_counter() - start
        spent, longest, pairs, early_mb = 0.0, 0.0, 0, 0.0
        for report in landing.reports():
            start = time.perf_counter()
            sink.write(report)
            step = time.perf_counter() - start
            spent, longest, pairs = spent + step, max(longest, step), pairs + 1
            if pairs == 600:
                early_mb = _peak_mb()
        start = time.perf_counter()
        sink.close()
        closed = time.perf_counter() - start
        print(f"pairs                 {pairs}")
        print(f"opening               {opened * 1e3:.0f} ms")
        print(f"writing, each pair    {spent / pairs * 1e3:.3f} ms (longest {longest * 1e3:.1f} ms)")
        print(f"closing               {closed * 1e3:.0f} ms")
        print(f"all, each pair        {(opened + spent + closed) / pairs * 1e3:.3f} ms")
        print(f"peak memory           {early_mb:.0f} MB after 600 pairs, {_peak_mb():.0f} MB at the end")
        print(f"file                  {path.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
