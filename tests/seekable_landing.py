"""A copy of the bundled landing whose second half is read without decoding the first.

Its videos have two key frames each: a replay from 20 s on decodes the 195 pictures before, two seconds of a core for
half a second of work. In the copy each picture stands alone, and is the same to the last bit.
"""

import hashlib
import shutil
from fractions import Fraction
from pathlib import Path

import av
import numpy as np

from tests.compile_once import alone

FIRST_S = 20.0
# taken at 19.6 s
_FIRST_FRAME = 190
_RATE_HZ = 10


def seekable_landing(landing: Path, folder: Path) -> Path:
    """Return the copy in a folder, written if it is not there yet; pictures before `FIRST_S` are grey in it.

    It is kept for later runs, under the hash of what it is made of and by.
    """
    sources = [*sorted(file for file in landing.iterdir() if file.is_file()), Path(__file__)]
    kept = folder / hashlib.sha256(b"".join(file.read_bytes() for file in sources)).hexdigest()[:16]
    copy, done = kept / "recordings" / landing.name, kept / "done"
    with alone(kept / "lock"):
        if not done.exists():
            copy.mkdir(parents=True, exist_ok=True)
            for file in sources[:-1]:
                if file.suffix == ".mp4":
                    _write_video(file, copy / f"{file.stem}.avi")
                else:
                    shutil.copy(file, copy)
            done.touch()
    return copy


def _write_video(video: Path, copy: Path) -> None:
    """Write the pictures that a video decodes to, without loss; the decoder's own planes, not their colours."""
    with av.open(str(video)) as decoded, av.open(str(copy), "w") as written:
        source = decoded.streams.video[0]
        stream = written.add_stream("utvideo", rate=_RATE_HZ)
        stream.width, stream.height, stream.pix_fmt = source.width, source.height, source.pix_fmt
        grey = av.VideoFrame.from_ndarray(np.full((source.height * 3 // 2, source.width), 128, np.uint8), "yuv420p")
        for number, frame in enumerate(decoded.decode(source)):
            picture = grey if number < _FIRST_FRAME else frame
            picture.pts, picture.time_base = number, Fraction(1, _RATE_HZ)
            written.mux(stream.encode(picture))
        written.mux(stream.encode())
