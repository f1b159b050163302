"""The lines of a log that may hold anything: binary stretches, endless lines, a cut end."""

from collections.abc import Iterator
from pathlib import Path

from groundstation.errors import LogError, os_words
from groundstation.session.logs.fixes import ReadingNotes

MAX_LINE_BYTES = 4096
MAX_LOG_BYTES = 4_000_000_000


def check_file(path: Path) -> None:
    """Raise `LogError` if there is no such file, or one too large to be read."""
    if not path.is_file():
        got = "a folder" if path.is_dir() else "no such file"
        raise LogError(str(path), got=got, wanted="a log of positions")
    size = path.stat().st_size
    if size > MAX_LOG_BYTES:
        raise LogError(str(path), got=f"{size} bytes", wanted=f"at most {MAX_LOG_BYTES} bytes")


def text_lines(path: Path, remarks: ReadingNotes) -> Iterator[tuple[int, str, bool]]:
    """Yield number, text and whether its end is present of each line; one too long for a log is counted and skipped."""
    try:
        with path.open("rb") as stream:
            number, skipping = 0, False
            while chunk := stream.readline(MAX_LINE_BYTES):
                whole = chunk.endswith(b"\n")
                if not skipping:
                    number += 1
                if not skipping and (whole or len(chunk) < MAX_LINE_BYTES):
                    yield number, chunk.decode("latin-1").rstrip("\r\n"), whole
                elif not skipping:
                    remarks.count(f"line of more than {MAX_LINE_BYTES} bytes", f"line {number}")
                skipping = not whole
    except OSError as fault:
        raise LogError(str(path), got=os_words(fault), wanted="a file that can be read") from fault
