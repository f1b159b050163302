"""report.html of a lens calibration: one self-contained page, for a screen, a phone or paper."""

import base64
from html import escape
from pathlib import Path

from calibration.intrinsics import Intrinsics
from calibration.lens_advice import RANGES_M, across_m, advise, along_m, middle_angle_deg
from calibration.lens_model import PARAMETERS
from calibration.lens_pictures import LensPicture, lens_pictures

PAGE_STYLE = """
:root{--ink:#1b1f24;--soft:#5a636e;--line:#d9dde2;--panel:#f6f8fa;--accent:#0072B2}
*{box-sizing:border-box}
body{margin:0 auto;max-width:1180px;padding:1.2rem 1rem 3rem;font:16px/1.5 system-ui,-apple-system,"Segoe UI",
Roboto,"Helvetica Neue",Arial,sans-serif;color:var(--ink);background:#fff}
h1{font-size:1.6rem;margin:.2rem 0}h2{font-size:1.2rem;margin:2rem 0 .6rem;border-bottom:1px solid var(--line)}
h3{font-size:1rem;margin:1rem 0 .2rem}p,li{max-width:75ch}.soft,figcaption{color:var(--soft);font-size:.88rem}
.verdict{font-size:1.1rem;border-left:4px solid var(--accent);padding:.3rem 0 .3rem .9rem;margin:.8rem 0 1.2rem}
.wide{overflow-x:auto}table{border-collapse:collapse;font-size:.92rem;font-variant-numeric:tabular-nums}
th,td{padding:.25rem .6rem;text-align:right;white-space:nowrap;border-bottom:1px solid var(--line)}
th:first-child,td:first-child,td.text,th.text{text-align:left}thead th{color:var(--soft);font-weight:600}
.pictures{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,440px),1fr));gap:1.2rem}
figure{margin:0;break-inside:avoid}img{width:100%;height:auto;display:block}
"""


def write_lens_report(folder: Path, found: Intrinsics, name: str) -> list[Path]:
    """Write report.html and the pictures as PNG into ``folder``, made if missing; returns what was written."""
    folder.mkdir(parents=True, exist_ok=True)
    pictures = lens_pictures(found)
    written = [folder / "report.html"]
    written[0].write_text(lens_report(found, pictures, name), encoding="utf-8")
    for picture in pictures:
        written.append(folder / f"{picture.name}.png")
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
            "<h2>What to do next</h2>" + _list(advice.next_steps),
            "<h2>What was found</h2>" + _list(advice.notes),
            f"<p class='soft'>{w} × {h} px; board {escape(_board(found))}.</p>",
            _parameters(found),
            _ranges(found),
            "<h2>Pictures</h2><div class='pictures'>" + "".join(_figure(p) for p in pictures) + "</div>",
            _views(found),
        ]
    )
    return (
        "<!DOCTYPE html>\n<html lang='en'><head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>"
        f"<title>{escape(name)} – lens</title><style>{PAGE_STYLE}</style></head><body>\n{body}\n</body></html>\n"
    )


def _board(found: Intrinsics) -> str:
    b = found.board
    if b.kind == "chessboard":
        return f"chessboard, {b.columns} × {b.rows} inner corners, squares of {1000 * b.square_m:g} mm"
    size = f"{b.columns} × {b.rows} squares of {1000 * b.square_m:g} mm"
    return f"ChArUco, {size}, markers of {1000 * b.marker_m:g} mm, {b.dictionary}"


def _list(lines: tuple[str, ...]) -> str:
    return "<ul>" + "".join(f"<li>{escape(line)}</li>" for line in lines) + "</ul>"


def _figure(picture: LensPicture) -> str:
    data = base64.b64encode(picture.png).decode("ascii")
    return (
        f"<figure><h3>{escape(picture.title)}</h3>"
        f"<img alt='{escape(picture.title)}' src='data:image/png;base64,{data}'>"
        f"<figcaption>{escape(picture.caption)}</figcaption></figure>"
    )


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
