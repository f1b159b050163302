"""The runway-edge paper's figure 1: how much Canny's edges hang on the width of its filter."""

from pathlib import Path

import cv2
import numpy as np

from groundstation.arrays import FloatArray, MaskArray
from groundstation.experiments import detection_plots as plots
from groundstation.experiments.experiment import Findings, PaperFigure
from groundstation.experiments.tables import Cell, ResultTable
from groundstation.experiments.truth_session import TruthSession
from groundstation.messages import Frame
from groundstation.sources.folder_source import FolderSource

SIGMAS_PX = (1.0, 10.0, 20.0)
_HIGH, _LOW = 0.4, 0.1
_SCALE = 16000.0
_NEAR_PX = 3
_EVERY = 8


def canny(recorded: TruthSession) -> Findings:
    """Edges at σ 1, 10 and 20 of these pictures, thresholds 0.4 and 0.1 (figure 1 of the runway-edge paper)."""
    pictures = _pictures(recorded)
    edges = {sigma: [canny_edges(p, sigma) for p in pictures] for sigma in SIGMAS_PX}
    rows: list[list[Cell]] = []
    for sigma in SIGMAS_PX:
        count = float(np.mean([np.count_nonzero(e) for e in edges[sigma]]))
        pieces = float(np.mean([cv2.connectedComponents(e.astype(np.uint8))[0] - 1 for e in edges[sigma]]))
        kept = [_share(fine, coarse) for fine, coarse in zip(edges[SIGMAS_PX[0]], edges[sigma], strict=True)]
        back = [_share(coarse, fine) for fine, coarse in zip(edges[SIGMAS_PX[0]], edges[sigma], strict=True)]
        rows.append([sigma, count, pieces, float(np.mean(kept)), float(np.mean(back))])
    table = ResultTable(
        name="canny",
        title="Figure 1: edges by Canny's σ",
        columns=("σ px", "edge pixels", "pieces", "of σ 1's still there %", "lying on σ 1's %"),
        rows=rows,
        notes=(
            f"Mean of {len(pictures)} whole pictures of the left camera, grey; there, or lying on: within {_NEAR_PX} "
            f"px. Thresholds {_HIGH} and {_LOW} of the largest gradient, at each σ.",
            "The paper has pictures and no numbers: “a small variation of the parameters can dramatically affect the "
            "features extracted”.",
        ),
    )
    shown = pictures[-1]
    figure = PaperFigure(
        name="canny",
        title="Figure 1: a picture and its edges at σ 1, 10, 20",
        caption="The last picture looked at, of the left camera.",
        draw=lambda path: _draw(shown, path),
    )
    differences = (
        "The paper's picture is from an aircraft on approach to a runway; ours are a ground station's, along the "
        "runway with markings, trees and sky, while the aircraft lands.",
        "That the thresholds 0.4 and 0.1 are shares of the largest gradient is our reading.",
    )
    return Findings(tables=(table,), figures=(figure,), differences=differences)


def canny_edges(grey: FloatArray, sigma_px: float) -> MaskArray:
    """Return Canny's edges (h, w) of a grey picture (h, w) smoothed with ``sigma_px``."""
    smooth = cv2.GaussianBlur(np.asarray(grey, dtype=np.float64), (0, 0), sigma_px, borderType=cv2.BORDER_REPLICATE)
    du, dv = (cv2.Sobel(smooth, cv2.CV_64F, *order, ksize=3) for order in ((1, 0), (0, 1)))
    largest = float(np.hypot(du, dv).max())
    if largest <= 0.0:
        return np.zeros(grey.shape, dtype=np.bool_)
    scaled = [np.round(_SCALE / largest * d).astype(np.int16) for d in (du, dv)]
    found = cv2.Canny(scaled[0], scaled[1], _LOW * _SCALE, _HIGH * _SCALE, L2gradient=True)
    return np.asarray(found > 0)


def _share(of: MaskArray, near: MaskArray) -> float:
    """Return the share of the edges ``of`` that are close to the edges ``near``, in %."""
    about = cv2.dilate(near.astype(np.uint8), np.ones((2 * _NEAR_PX + 1, 2 * _NEAR_PX + 1), np.uint8)) > 0
    return 100.0 * float(np.count_nonzero(of & about)) / max(int(np.count_nonzero(of)), 1)


def _pictures(recorded: TruthSession) -> list[FloatArray]:
    """Return every `_EVERY`-th picture of the first station where there is more than sky; all where it never is."""
    ground = [p for p in recorded.session.phases if p.background != "sky"]
    from_s = max(recorded.from_s, min(p.from_s for p in ground)) if ground else recorded.from_s
    if from_s >= recorded.to_s or not np.any((recorded.truth.t_s >= from_s) & recorded.inside(recorded.truth.t_s)):
        from_s = recorded.from_s
    limits = [None if np.isinf(v) else float(v) for v in (from_s, recorded.to_s)]
    name, found = recorded.session.rig.names[0], []
    with FolderSource(recorded.session, *limits) as source:
        frames = (e for e in source if isinstance(e, Frame) and e.station == name)
        for k, frame in enumerate(frames):
            if k % _EVERY == 0:
                found.append(np.asarray(cv2.cvtColor(frame.image.whole(), cv2.COLOR_BGR2GRAY), dtype=np.float64))
    return found


def _draw(picture: FloatArray, path: Path) -> None:
    figure, panels = plots.blank(2, 2, (10.0, 7.8))
    panels[0].imshow(picture, cmap="gray")
    panels[0].set_title("picture", fontsize=10)
    for ax, sigma in zip(panels[1:], SIGMAS_PX, strict=True):
        ax.imshow(~canny_edges(picture, sigma), cmap="gray")
        ax.set_title(f"σ = {sigma:g} px", fontsize=10)
    for ax in panels:
        ax.set_axis_off()
    plots.save(figure, path)
