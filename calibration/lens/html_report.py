"""report.html of a lens calibration: one self-contained page, for a screen, a phone or paper."""

from pathlib import Path

from calibration.lens.advice import RANGES_M, across_m, advise, along_m, middle_angle_deg
from calibration.lens.intrinsics import Intrinsics
from calibration.lens.model import PARAMETERS
from calibration.lens.report_pictures import lens_pictures
from calibration.report.picture import ReportPicture, shown, write_page
from groundstation.files.html_page import (
    Column,
    bullet_list,
    html_page,
    page_header,
    soft_line,
    text_table,
    verdict_line,
)


def write_lens_report(folder: Path, found: Intrinsics, name: str) -> list[Path]:
    """Write report.html and the pictures as PNG into ``folder``, created if missing; returns the written files."""
    pictures = lens_pictures(found)
    return write_page(folder, lens_report(found, pictures, name), pictures)


def lens_report(found: Intrinsics, pictures: list[ReportPicture], name: str) -> str:
    """Return the page; it loads nothing from anywhere."""
    advice = advise(found)
    w, h = found.fit.lens.image_size_px
    body = "\n".join(
        [
            page_header("lens calibration", name),
            verdict_line(advice.verdict),
            "<h2>What to do next</h2>" + bullet_list(advice.next_steps),
            "<h2>What was found</h2>" + bullet_list(advice.notes),
            soft_line(f"{w} × {h} px; board {_board(found)}."),
            _parameters(found),
            _ranges(found),
            "<h2>Pictures</h2>" + shown(pictures),
            _views(found),
        ]
    )
    return html_page(f"{name} – lens", body)


def _board(found: Intrinsics) -> str:
    b = found.board
    if b.kind == "chessboard":
        return f"chessboard, {b.columns} × {b.rows} inner corners, squares of {1000 * b.square_m:g} mm"
    size = f"{b.columns} × {b.rows} squares of {1000 * b.square_m:g} mm"
    return f"ChArUco, {size}, markers of {1000 * b.marker_m:g} mm, {b.dictionary}"


def _parameters(found: Intrinsics) -> str:
    lens = found.fit.lens
    values = [*lens.focal_px, *lens.principal_point_px, *lens.distortion]
    rows = [
        (name, f"{value:.6g}", "held" if sigma == 0 else format(sigma, ".2g"))
        for name, value, sigma in zip(PARAMETERS, values, found.fit.sigma, strict=True)
    ]
    return "<h2>The lens</h2>" + text_table(("", "value", "1 σ"), rows)


def _ranges(found: Intrinsics) -> str:
    angle = middle_angle_deg(found)
    rows = [(f"{r:g} m", f"{across_m(angle, r):.3f} m", f"{along_m(angle, r):.2f} m") for r in RANGES_M]
    return "<h2>What that is in the air</h2>" + text_table(("range", "across", "along, two cameras 10 m apart"), rows)


def _views(found: Intrinsics) -> str:
    held = {v.name: f"{e:.3f}" for v, e in zip(found.views, found.held_out.by_view_px, strict=True)}
    rows = [(v.name, v.choice.value, held.get(v.name, ""), v.detail) for v in found.verdicts]
    columns = ("", Column("used", text=True), "held out, px", Column("why", text=True))
    return "<h2>The pictures that were given</h2>" + text_table(columns, rows)
