"""Kill -9 a recording process at 50 random moments: is every complete chunk recovered, and how much is lost?

The child records a synthetic flight of two raw cameras at 30 pairs/s in real time and prints after each pair how many
events it has handed over. What `recover` gives is compared with what was handed over, pixel by pixel.
"""

import argparse
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from groundstation.messages import Epoch  # noqa: E402
from groundstation.recording.mcap_reader import McapReader  # noqa: E402
from groundstation.recording.recorder import Recorder  # noqa: E402
from groundstation.recording.recovery import recover  # noqa: E402
from tests.recording.recorded import events, header, looked_at, played, same, small_rig  # noqa: E402

SEED, PAIR_S = 1, 1.0 / 30.0


def child(path: Path) -> None:
    recorder = Recorder(path, small_rig(), header())
    began = time.monotonic()
    for number, event in enumerate(recorder.taken(events(10**6, np.random.default_rng(SEED))), start=1):
        recorder.write(looked_at(event))
        if isinstance(event, Epoch):
            print(number, event.t_s, flush=True)
            time.sleep(max(0.0, began + PAIR_S * event.epoch - time.monotonic()))


def killed(path: Path, after_s: float) -> tuple[int, float]:
    """Run a child for so long after its first pair; returns its last message."""
    process = subprocess.Popen(
        [sys.executable, __file__, "--child", str(path)], stdout=subprocess.PIPE, text=True, cwd=ROOT
    )
    assert process.stdout is not None
    reported = process.stdout.readline()
    time.sleep(after_s)
    process.send_signal(signal.SIGKILL)
    rest = process.stdout.read().splitlines()
    process.wait()
    words = [w.split() for w in [reported, *rest] if len(w.split()) == 2]
    return int(words[-1][0]), float(words[-1][1])


def one(folder: Path, after_s: float) -> tuple[float, bool]:
    """Kill once; returns how many seconds of the flight are lost, and whether all complete data are there."""
    path = folder / "flight.mcap"
    number, said_s = killed(path, after_s)
    with McapReader(path) as reader:
        before = reader.contents()
    done = recover(path)
    assert done.out is not None
    back, source = played(done.out)
    given = [e for e, _ in zip(events(10**6, np.random.default_rng(SEED)), range(len(back)), strict=False)]
    complete = len(back) - source.missing.frames
    right = all(same(a, b) for a, b in zip(given[:complete], back[:complete], strict=True))
    right &= done.chunks == before.chunks and done.skipped == 0 and source.missing.events == 0
    last_s = max(event.t_s for event in back[:complete])
    path.unlink()
    done.out.unlink()
    return max(0.0, said_s - last_s), right and complete <= number + 20


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--child", type=Path)
    parser.add_argument("--kills", type=int, default=50)
    options = parser.parse_args()
    if options.child is not None:
        child(options.child)
        return
    rng = np.random.default_rng(7)
    lost = []
    with tempfile.TemporaryDirectory() as folder:
        for k in range(options.kills):
            seconds, right = one(Path(folder), float(rng.uniform(0.6, 3.0)))
            if not right:
                sys.exit(f"kill {k}: what was recovered is not what was whole")
            lost.append(seconds)
    print(f"{len(lost)} kills: every complete chunk recovered, every count and pixel right")
    print(f"lost of the flight: {np.median(lost):.3f} s median, {max(lost):.3f} s at most")
    if max(lost) >= 1.0:
        sys.exit("more than a second was lost")


if __name__ == "__main__":
    main()
