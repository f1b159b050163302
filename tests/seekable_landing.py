"""Copies of recorded flights that are read in less time: each picture stands alone, the same to the last bit.

The bundled landing's videos have two key frames each: a replay from 20 s on decodes the 195 pictures before, two
seconds of a core for half a second of work. And a picture without loss is decoded in a third of the time of H.264.
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
    """Return the landing's copy in a folder, written if it is not there yet; pictures before `FIRST_S` are grey in it.

    It is kept for later runs, under the hash of what it is made of and by.
    """
    return _copied(landing, folder, _FIRST_FRAME)


def lossless_copy(session: Path, folder: Path) -> Path:
    """Return a session's copy with all pictures, made and kept in the same way."""
    return _copied(session, folder, 0)


def _copied(session: Path, folder: Path, first_frame: int) -> Path:
    sources = [*sorted(file for file in session.iterdir() if file.is_file()), Path(__file__)]
    made_of = [str(first_frame).encode(), *(file.read_bytes() for file in sources)]
    kept = folder / hashlib.sha256(b"".join(made_of)).hexdigest()[:16]
    copy, done = kept / "recordings" / session.name, kept / "done"
    with alone(kept / "lock"):
        if not done.exists():
            copy.mkdir(parents=True, exist_ok=True)
            for file in sources[:-1]:
                if file.suffix == ".mp4":
                    _write_video(file, copy / f"{file.stem}.avi", first_frame)
                else:
                    shutil.copy(file, copy)
            done.touch()
    return copy


def _write_video(video: Path, copy: Path, first_frame: int) -> None:
    """Write the pictures that a video decodes to, without loss; the decoder's own planes, not their colours."""
    with av.open(str(video)) as decoded, av.open(str(copy), "w") as written:
        source = decoded.streams.video[0]
        stream = written.add_stream("utvideo", rate=_RATE_HZ)
        stream.width, stream.height, stream.pix_fmt = source.width, source.height, source.pix_fmt
        grey = av.VideoFrame.from_ndarray(np.full((source.height * 3 // 2, source.width), 128, np.uint8), "yuv420p")
        for number, frame in enumerate(decoded.decode(source)):
            picture = grey if number < first_frame else frame
            picture.pts, picture.time_base = number, Fraction(1, _RATE_HZ)
            written.mux(stream.encode(picture))
        written.mux(stream.encode())
