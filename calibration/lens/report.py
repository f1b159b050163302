"""report.html of a lens calibration: one self-contained page, for a screen, a phone or paper."""

from html import escape
from pathlib import Path

from calibration.lens.advice import RANGES_M, across_m, advise, along_m, middle_angle_deg
from calibration.lens.intrinsics import Intrinsics
from calibration.lens.model import PARAMETERS
from calibration.lens.report_pictures import LensPicture, lens_pictures
from calibration.report.page import report_figure, report_list, report_page
from groundstation.files.output_names import below


def write_lens_report(folder: Path, found: Intrinsics, name: str) -> list[Path]:
    """Write report.html and the pictures as PNG into ``folder``, made if missing; returns what was written."""
    folder.mkdir(parents=True, exist_ok=True)
    pictures = lens_pictures(found)
    written = [folder / "report.html"]
    written[0].write_text(lens_report(found, pictures, name), encoding="utf-8")
    for picture in pictures:
        written.append(below(folder, f"{picture.name}.png"))
        written[-1].write_bytes(picture.png)
    return written


def lens_report(found: Intrinsics, pictures: list[LensPicture], name: str) -> str:
    """Return the page; it loads nothing from anywhere."""
    advice = advise(found)
    w, h = found.fit.lens.image_size_px
    body = "\n".join(
        [
            f"<p class='soft'>Groundstation · lens calibration</p><h1>{escape(name)}</h1>",
            f"<p class='verdict'>{escape(advice.verdict)}</p>",
            "<h2>What to do next</h2>" + report_list(advice.next_steps),
            "<h2>What was found</h2>" + report_list(advice.notes),
            f"<p class='soft'>{w} × {h} px; board {escape(_board(found))}.</p>",
            _parameters(found),
            _ranges(found),
            "<h2>Pictures</h2><div class='pictures'>"
            + "".join(report_figure(p.title, p.caption, p.png) for p in pictures)
            + "</div>",
            _views(found),
        ]
    )
    return report_page(f"{name} – lens", body)


def _board(found: Intrinsics) -> str:
    b = found.board
    if b.kind == "chessboard":
        return f"chessboard, {b.columns} × {b.rows} inner corners, squares of {1000 * b.square_m:g} mm"
    size = f"{b.columns} × {b.rows} squares of {1000 * b.square_m:g} mm"
    return f"ChArUco, {size}, markers of {1000 * b.marker_m:g} mm, {b.dictionary}"


def _parameters(found: Intrinsics) -> str:
    lens = found.fit.lens
    values = [*lens.focal_px, *lens.principal_point_px, *lens.distortion]
    rows = "".join(
        f"<tr><td>{name}</td><td>{value:.6g}</td><td>{'held' if sigma == 0 else format(sigma, '.2g')}</td></tr>"
        for name, value, sigma in zip(PARAMETERS, values, found.fit.sigma, strict=True)
    )
    return (
        "<h2>The lens</h2><div class='wide'><table><thead><tr><th></th><th>value</th><th>1 σ</th></tr></thead>"
        f"<tbody>{rows}</tbody></table></div>"
    )


def _ranges(found: Intrinsics) -> str:
    angle = middle_angle_deg(found)
    rows = "".join(
        f"<tr><td>{r:g} m</td><td>{across_m(angle, r):.3f} m</td><td>{along_m(angle, r):.2f} m</td></tr>"
        for r in RANGES_M
    )
    return (
        "<h2>What that is in the air</h2><div class='wide'><table><thead><tr><th>range</th><th>across</th>"
        f"<th>along, two cameras 10 m apart</th></tr></thead><tbody>{rows}</tbody></table></div>"
    )


def _views(found: Intrinsics) -> str:
    held = {v.name: f"{e:.3f}" for v, e in zip(found.views, found.held_out.by_view_px, strict=True)}
    rows = "".join(
        f"<tr><td>{escape(v.name)}</td><td class=text>{v.choice.value}</td><td>{held.get(v.name, '')}</td>"
        f"<td class=text>{escape(v.detail)}</td></tr>"
        for v in found.verdicts
    )
    return (
        "<h2>The pictures that were given</h2><div class='wide'><table><thead><tr><th></th><th class=text></th>"
        f"<th>held out, px</th><th class=text></th></tr></thead><tbody>{rows}</tbody></table></div>"
    )
