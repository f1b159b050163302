"""`groundstation calibrate intrinsics` on drawn lenses and boards: errors over claimed sigmas.

    python benchmarks/lens_study.py [--lenses 200] [--workers N]

Each lens has its own focal lengths (5 %), centre (2 % of the picture's size) and distortion; boards stand anywhere,
tilted up to 40°; corners with 0.1 px of white noise, or boards that bend by as much in each view. Corners are
drawn, not found in pictures. Figures in docs/notes/calibration.md.
"""

import argparse
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from parallel_study import StudyRun, add_study_arguments, in_blocks
from scipy.stats import chi2

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from calibration.lens.boards import parse_board
from calibration.lens.corners import BoardView
from calibration.lens.fit import fit_lens
from calibration.lens.model import PARAMETERS
from groundstation.geometry.camera import Lens
from tests.calibration.lens.boards_seen import a_lens, corner_views, parameters

BOARD = parse_board("charuco:9x7:0.04:0.03")
NOISE_PX = 0.1
# lenses to a job: some seconds
BLOCK = 20
_K3 = PARAMETERS.index("distortion.k3")


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """A kind of lens and how it is shown boards; ``bent`` px, how far a board's bend moves its corners."""

    size_px: tuple[int, int]
    focal_px: float
    views: int
    held: frozenset[str] = frozenset()
    bent_px: float = 0.0


CASES = {
    "640x480 px, f 700 px, 16 views": Case(size_px=(640, 480), focal_px=700.0, views=16),
    "the same, boards bent": Case(size_px=(640, 480), focal_px=700.0, views=16, bent_px=0.1),
    "1280x960 px, f 6684 px, 20 views": Case(size_px=(1280, 960), focal_px=6684.0, views=20),
    "the same, k3 held": Case(size_px=(1280, 960), focal_px=6684.0, views=20, held=frozenset({"k3"})),
}


def drawn_lens(case: Case, generator: np.random.Generator) -> Lens:
    """Return a lens of a kind, k3 zero where it is held."""
    usual = a_lens(case.size_px, case.focal_px)
    scale = np.array([0.05, 0.05, 2e-4, 2e-4, 0.0 if case.held else 0.02])
    return replace(
        usual,
        focal_px=usual.focal_px * (1.0 + 0.05 * generator.normal() + 0.002 * generator.normal(size=2)),
        principal_point_px=usual.principal_point_px + 0.02 * np.array(case.size_px) * generator.normal(size=2),
        distortion=usual.distortion + scale * generator.normal(size=5),
    )


def bent(view: BoardView, size_px: float, generator: np.random.Generator) -> BoardView:
    """Displace a view's corners by a randomly drawn bend of the board."""
    flat = view.board_m - view.board_m.mean(axis=0)
    x, y = (flat / flat.std(axis=0).max())[:, :2].T
    curve = np.column_stack([x * x, y * y, x * y]) @ generator.normal(size=(3, 2))
    return replace(view, pixel=view.pixel + size_px * curve)


def free_parameters(case: Case) -> list[int]:
    """Return which parameters are free."""
    return [k for k in range(len(PARAMETERS)) if not (k == _K3 and case.held)]


def fitted(job: tuple[str, list[int]]) -> list[tuple[list[float], list[float], float]]:
    """Return, for each seed of a kind's block, errors and sigmas (p,) of the free parameters, and eᵀC⁻¹e."""
    label, seeds = job
    case = CASES[label]
    free, found = np.array(free_parameters(case)), []
    for seed in seeds:
        generator = np.random.default_rng([31, seed])
        lens = drawn_lens(case, generator)
        views = corner_views(generator, BOARD, lens, case.views, sigma_px=NOISE_PX)
        if case.bent_px:
            views = [bent(view, case.bent_px, generator) for view in views]
        fit = fit_lens(views, lens.image_size_px, held=case.held)
        error = (parameters(fit.lens) - parameters(lens))[free]
        together = error @ np.linalg.solve(fit.covariance[np.ix_(free, free)], error)
        found.append((error.tolist(), fit.sigma[free].tolist(), float(together)))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--lenses", type=int, default=200)
    add_study_arguments(parser, "lens")
    options = parser.parse_args()
    n = options.lenses
    blocks = in_blocks(range(n), BLOCK)
    jobs = {f"kind-{kind}-{block[0]}": (label, block) for kind, label in enumerate(CASES) for block in blocks}
    values = StudyRun.chosen("lenses", options).values(fitted, jobs)
    low, high = chi2.ppf([0.001, 0.999], n) / n
    print(f"{n} lenses each; chi2/n of errors over claimed sigmas, 99.8 % of such: {low:.2f} to {high:.2f}")
    for kind, (label, case) in enumerate(CASES.items()):
        lenses = [lens for block in blocks for lens in values[f"kind-{kind}-{block[0]}"]]
        errors, sigmas, together = (np.array(column) for column in zip(*lenses, strict=True))
        print(label)
        free = free_parameters(case)
        for column, k in enumerate(free):
            rms, reported = (float(np.sqrt(np.mean(v[:, column] ** 2))) for v in (errors, sigmas))
            square = float(np.mean((errors[:, column] / sigmas[:, column]) ** 2))
            mark = "" if low <= square <= high else "  OUTSIDE"
            print(f"  {PARAMETERS[k]:<20} rms {rms:.4g}, sigma {reported:.4g}; chi2/n {square:.2f}{mark}")
        p = len(free)
        least, most = chi2.ppf([0.001, 0.999], n * p) / n
        print(f"  all together {together.mean():.2f} of {p}, {least:.2f} to {most:.2f}")


if __name__ == "__main__":
    main()
