"""Pictures of a report: in the page, and as files next to it."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from groundstation.errors import InputError, os_words
from groundstation.files.html_page import picture_grid, png_figure
from groundstation.files.output_names import below
from groundstation.files.whole_file import write_whole


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportPicture:
    """One picture: file ``name`` without suffix, ``title``, ``caption``, and the PNG file's bytes."""

    name: str
    title: str
    caption: str
    png: bytes


def shown(pictures: Sequence[ReportPicture]) -> str:
    """Return the pictures side by side, as HTML."""
    return picture_grid(png_figure(p.title, p.caption, p.png) for p in pictures)


def write_page(folder: Path, text: str, pictures: Sequence[ReportPicture]) -> list[Path]:
    """Write report.html and the pictures as PNG into ``folder``, created if missing; returns the written files.

    Raises `InputError` where they cannot be written.
    """
    written = [folder / "report.html"]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_whole(written[0], text)
        for picture in pictures:
            written.append(below(folder, f"{picture.name}.png"))
            write_whole(written[-1], picture.png)
    except OSError as error:
        raise InputError(str(folder), got=os_words(error), wanted="a folder that can be written") from error
    return written
