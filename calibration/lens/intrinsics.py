"""A lens from pictures of a board: find corners, choose views, fit, evaluate; a wrong lens is refused."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from calibration.errors import IntrinsicsError
from calibration.lens.boards import CalibrationBoard
from calibration.lens.corners import BoardView, CornerFinder, other_chessboard
from calibration.lens.fit import LensFit, fit_lens
from calibration.lens.model import CalibratedLens
from calibration.lens.quality import HeldOutViews, UncertaintyMap, hold_out, uncertainty_map
from calibration.lens.view_choice import Choice, ChosenViews, ViewVerdict, choose_views
from calibration.pictures import GreyPicture
from groundstation.arrays import ImageArray

# five parts to hold out in turn, and something left to learn from
FEWEST_VIEWS = 6
# a view this many times worse than the median one, and by this much, has wrong corners in it
_MISFIT_RATIO = 4.0
_MISFIT_PX = 0.5
# the board is not the one described, or is not flat
_WORST_HELD_OUT_PX = 2.0
_PX_OF_DIAGONAL = 1.0 / 800.0
_WORST_FOCAL = 0.05


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Intrinsics:
    """Result of a lens calibration.

    Attributes
    ----------
    board : the board that was searched for.
    fit : lens, covariance, residuals of ``views``.
    held_out : the same on views that the fit does not use.
    held_out_without_k3_px : the held-out error of a lens without k3; None where k3 was fixed, or differs from 0.
    map : the lens's uncertainty over the image.
    views : the views used; verdicts: one on each picture.
    held : coefficients fixed at zero.
    """

    board: CalibrationBoard
    fit: LensFit
    held_out: HeldOutViews
    held_out_without_k3_px: float | None
    map: UncertaintyMap
    views: tuple[BoardView, ...]
    verdicts: tuple[ViewVerdict, ...]
    held: frozenset[str]

    @property
    def calibrated(self) -> CalibratedLens:
        """Return the lens with its covariance, to be written."""
        return CalibratedLens(lens=self.fit.lens, covariance=self.fit.covariance)


def calibrate_intrinsics(
    pictures: Iterable[GreyPicture],
    board: CalibrationBoard,
    *,
    held: frozenset[str] = frozenset(),
    progress: Callable[[int], None] | None = None,
) -> Intrinsics:
    """Estimate a lens from pictures of a board.

    Parameters
    ----------
    pictures : grey pictures, all of one size; read one at a time.
    held : coefficients that stay zero, see `lens_fit.HOLDABLE`.
    progress : called with the number of pictures searched so far.

    Raises
    ------
    IntrinsicsError : no board, too few different views, or a result of insufficient quality.
    """
    finder = CornerFinder(board)
    found: list[BoardView] = []
    blank: list[str] = []
    shape: tuple[int, ...] = ()
    last: ImageArray | None = None
    for count, picture in enumerate(pictures, start=1):
        shape, last = picture.grey.shape, picture.grey
        view = finder.find(picture.name, picture.grey)
        if view is None:
            blank.append(picture.name)
        else:
            found.append(view)
        if progress is not None:
            progress(count)
    if last is None:
        raise IntrinsicsError("the pictures", got="none of them", wanted="pictures of a board")
    if not found:
        raise _no_board(board, last, len(blank))
    chosen = choose_views(found, board, (shape[1], shape[0]))
    no_board = tuple(ViewVerdict(name=name, choice=Choice.NO_BOARD) for name in blank)
    return solve_intrinsics(chosen, board, (shape[1], shape[0]), held=held, others=no_board)


def solve_intrinsics(
    chosen: ChosenViews,
    board: CalibrationBoard,
    image_size_px: tuple[int, int],
    *,
    held: frozenset[str] = frozenset(),
    others: tuple[ViewVerdict, ...] = (),
) -> Intrinsics:
    """Fit and evaluate the lens of chosen views; ``others`` are verdicts on pictures without a board.

    Raises
    ------
    IntrinsicsError : too few different views, or a result of insufficient quality.
    """
    verdicts = (*chosen.verdicts, *others)
    _check_enough(chosen.views, verdicts)
    kept = _fit_without_misfits(chosen.views, image_size_px, held)
    views, fit = kept.views, kept.fit
    verdicts = tuple(kept.misfits.get(v.name, v) for v in verdicts)
    _check_enough(views, verdicts)
    held_out = hold_out(views, fit, held=held)
    _check_believable(fit, held_out)
    without: float | None = None
    if "k3" not in held and abs(fit.lens.distortion[4]) < 2.0 * fit.sigma[8]:
        fewer = held | {"k3"}
        without = hold_out(views, fit_lens(views, image_size_px, held=fewer), held=fewer).rms_px
    return Intrinsics(
        board=board,
        fit=fit,
        held_out=held_out,
        held_out_without_k3_px=without,
        map=uncertainty_map(fit.lens, fit.covariance),
        views=views,
        verdicts=verdicts,
        held=held,
    )


def _no_board(board: CalibrationBoard, grey: ImageArray, count: int) -> IntrinsicsError:
    named = f"{board.kind}:{board.columns}x{board.rows}"
    other = other_chessboard(board, grey)
    if other:
        return IntrinsicsError(
            "--board", got=f"{named}", wanted=f"chessboard:{other}, which is in the pictures (inner corners count)"
        )
    hint = (
        "the board as it is: squares across and down, dictionary"
        if board.kind == "charuco"
        else "the board's inner corners"
    )
    return IntrinsicsError(
        "the pictures", got=f"no {named} in any of {count}", wanted=f"{hint}; and the whole of it lit"
    )


def _check_enough(views: tuple[BoardView, ...], verdicts: tuple[ViewVerdict, ...]) -> None:
    if len(views) >= FEWEST_VIEWS:
        return
    counts = [(c.value, sum(v.choice is c for v in verdicts)) for c in Choice if c is not Choice.USED]
    dropped = ", ".join(f"{n} {word}" for word, n in counts if n)
    raise IntrinsicsError(
        "the pictures",
        got=f"{len(views)} usable view{'s' * (len(views) != 1)} of {len(verdicts)} pictures"
        + (f" ({dropped})" if dropped else ""),
        wanted=f"at least {FEWEST_VIEWS} that differ in place, tilt and distance; 15 to 30 are better",
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _KeptViews:
    """The views that fit together, their fit, and a verdict on each that does not, by name."""

    views: tuple[BoardView, ...]
    fit: LensFit
    misfits: dict[str, ViewVerdict]


def _fit_without_misfits(
    views: tuple[BoardView, ...], image_size_px: tuple[int, int], held: frozenset[str]
) -> _KeptViews:
    """Drop the worst view as long as it stands out; at most a quarter of them."""
    misfits: dict[str, ViewVerdict] = {}
    most = len(views) // 4
    fit = fit_lens(views, image_size_px, held=held)
    while len(misfits) < most:
        rms = np.array([np.sqrt(np.mean(np.sum(r**2, axis=1))) for r in fit.residual])
        worst = int(np.argmax(rms))
        if rms[worst] < max(_MISFIT_RATIO * np.median(rms), _MISFIT_PX):
            break
        name = views[worst].name
        misfits[name] = ViewVerdict(name=name, choice=Choice.MISFIT, detail=f"off by {rms[worst]:.2f} px")
        views = (*views[:worst], *views[worst + 1 :])
        fit = fit_lens(views, image_size_px, held=held)
    return _KeptViews(views=views, fit=fit, misfits=misfits)


def _check_believable(fit: LensFit, held_out: HeldOutViews) -> None:
    limit = max(_WORST_HELD_OUT_PX, _PX_OF_DIAGONAL * float(np.hypot(*fit.lens.image_size_px)))
    if held_out.rms_px > limit:
        raise IntrinsicsError(
            "the pictures",
            got=f"corners {held_out.rms_px:.1f} px off in views that the lens was not fitted to",
            wanted=f"at most {limit:.1f} px: the board as described, flat, and held still",
        )
    part = float(np.max(fit.sigma[:2] / fit.lens.focal_px))
    if not part < _WORST_FOCAL:
        raise IntrinsicsError(
            "the pictures",
            got=f"a focal length uncertain by {100 * min(part, 9.99):.0f} %",
            wanted="boards tilted both ways by 20 to 45 degrees, near and far",
        )
