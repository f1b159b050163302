"""Layout of a recording in the viewer: views, their arrangement and the 3-D viewpoint."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from groundstation.arrays import FloatArray
from groundstation.rig.rig import Rig
from groundstation.viewer import entity_paths

MAX_NIS_SHOWN = 12.0
# the eye looks across the runway from the right, behind the stations; all in lengths of what is to be seen
EYE_FROM_MIDDLE = np.array([0.26, -0.60, 0.18])
TARGET_FROM_MIDDLE = -0.25
EXPECTED_LENGTH_M = 400.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Viewpoint:
    """Where the 3-D view is seen from, and the point looked at, (3,) each, runway frame."""

    position_m: FloatArray
    target_m: FloatArray


def eye_over(rig: Rig, lower_m: FloatArray, upper_m: FloatArray) -> Viewpoint:
    """Return an eye that has the stations and the box (3,) to (3,) of the track in view."""
    positions = np.array([s.ptu_position_m for s in rig.stations])
    low = np.minimum(positions.min(axis=0), lower_m)
    high = np.maximum(positions.max(axis=0), upper_m)
    middle, length = (low + high) / 2, float(np.linalg.norm(high - low))
    target = middle + TARGET_FROM_MIDDLE * (high - low) * [0.0, 1.0, 0.0]
    return Viewpoint(position_m=middle + length * EYE_FROM_MIDDLE, target_m=target)


def eye_before(rig: Rig) -> Viewpoint:
    """Return the eye while nothing is known of the track."""
    positions = np.array([s.ptu_position_m for s in rig.stations])
    return eye_over(rig, positions.min(axis=0), positions.max(axis=0) + np.array([0.0, EXPECTED_LENGTH_M, 0.0]))


def blueprint(
    rig: Rig, *, eye: Viewpoint, loop_s: tuple[float, float] | None, errors_against: str, approach: bool = False
) -> rrb.Blueprint:
    """Return the layout; ``loop_s`` is the part of the session that plays on opening, or None for all of it.

    With an ``approach`` its needles and height are among the plots.
    """
    left = rrb.Vertical(_scene(eye), _plots(rig, errors_against, approach=approach), row_shares=[6, 5])
    right = rrb.Vertical(_images(rig), _states(), row_shares=[4, 1])
    selection = None
    if loop_s is not None:
        start, end = (rr.TimeInt(seconds=t) for t in loop_s)
        selection = rrb.components.AbsoluteTimeRange(min=start, max=end)
    return rrb.Blueprint(
        rrb.Horizontal(left, right, column_shares=[5, 3]),
        rrb.TopPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(
            state="collapsed",
            timeline=entity_paths.TIMELINE,
            play_state="Playing",
            loop_mode="All" if selection is None else "Selection",
            time_selection=selection,
        ),
        auto_layout=False,
        auto_views=False,
    )


def live_blueprint(rig: Rig, eye: Viewpoint, *, approach: bool = False) -> rrb.Blueprint:
    """Return the operator's screen: pictures and words large, the newest always in view.

    With an ``approach`` its needles, height and lane of advice are on it.
    """
    words = rrb.TextDocumentView(origin=f"/{entity_paths.WORDS}", name="Station")
    landing = (_approach_plots(), _advice_lane()) if approach else ()
    plots = rrb.Horizontal(
        *landing,
        _plot(entity_paths.LATENCY, "Delay [ms]"),
        _plot(entity_paths.NIS, "NIS and 95 % bounds", top=MAX_NIS_SHOWN),
        _plot(
            entity_paths.PTU,
            "Pan and tilt [°]",
            [f"{entity_paths.PTU}/{s}/{kind}" for s in rig.names for kind in ("pan", "tilt")],
        ),
    )
    left = rrb.Vertical(words, _scene(eye), plots, row_shares=[3, 6, 3])
    right = rrb.Vertical(_images(rig), rrb.TextLogView(origin=f"/{entity_paths.LOG}", name="Log"), row_shares=[4, 1])
    return rrb.Blueprint(
        rrb.Horizontal(left, right, column_shares=[1, 1]),
        rrb.TopPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=entity_paths.TIMELINE, play_state="Following"),
        auto_layout=False,
        auto_views=False,
    )


def _so_far() -> rrb.VisibleTimeRanges:
    """Everything from the beginning to the cursor."""
    return rrb.VisibleTimeRanges(
        timeline=entity_paths.TIMELINE,
        start=rrb.TimeRangeBoundary.infinite(),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )


def _scene(eye: Viewpoint) -> rrb.Spatial3DView:
    """The 3-D view."""
    return rrb.Spatial3DView(
        origin="/",
        contents=["+ /world/**", f"+ /{entity_paths.AIRCRAFT}/**"],
        name="Runway",
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital, position=eye.position_m, look_target=eye.target_m, eye_up=[0.0, 0.0, 1.0]
        ),
        background=entity_paths.BACKGROUND,
        line_grid=rrb.LineGrid3D(visible=True, spacing=10.0, color=[120, 120, 120, 50]),
        overrides={
            entity_paths.EKF_PATH: _so_far(),
            entity_paths.EKF_ELLIPSOIDS: _so_far(),
            entity_paths.TRIANGULATION: _so_far(),
        },
    )


def _images(rig: Rig) -> rrb.Container:
    """One picture for each station, one below the other; beyond two, in a grid."""
    views = [
        rrb.Spatial2DView(
            origin=f"/{entity_paths.image(s.name)}",
            name=s.name,
            visual_bounds=rrb.VisualBounds2D(
                x_range=[0, s.lens.image_size_px[0]], y_range=[0, s.lens.image_size_px[1]]
            ),
        )
        for s in rig.stations
    ]
    return rrb.Vertical(*views) if len(views) <= 2 else rrb.Grid(*views)


def _states() -> rrb.Container:
    """The lanes of status, and the log."""
    return rrb.Tabs(
        rrb.StateTimelineView(origin=f"/{entity_paths.STATUS}", name="Status"),
        rrb.TextLogView(origin=f"/{entity_paths.LOG}", name="Log"),
    )


def _plot(origin: str, name: str, contents: Sequence[str] = (), top: float | None = None) -> rrb.TimeSeriesView:
    """A plot of everything below an entity, or of ``contents``; colours stand for a legend, which would cover it."""
    axis = None if top is None else rrb.ScalarAxis(range=(0.0, top), zoom_lock=True)
    return rrb.TimeSeriesView(
        origin=f"/{origin}",
        contents=[f"+ /{entity}" for entity in contents] or "$origin/**",
        name=name,
        axis_y=axis,
        plot_legend=rrb.PlotLegend(visible=False),
    )


def _plots(rig: Rig, errors_against: str, *, approach: bool) -> rrb.Container:
    """Errors, consistency with latency, pointing, and the approach if there is one, side by side."""
    against = {"": "reference", "dgps": "DGPS"}.get(errors_against, errors_against)
    errors = rrb.Vertical(*(_plot(f"{entity_paths.ERROR}/{a}", f"{a} − {against}, ±2σ [m]") for a in entity_paths.AXES))
    consistency = rrb.Vertical(
        _plot(entity_paths.NIS, "NIS and 95 % bounds", top=MAX_NIS_SHOWN),
        _plot(entity_paths.LATENCY, "Latency: pair, detections [ms]"),
    )
    ptu = {
        kind: [f"{entity_paths.PTU}/{s}/{kind}" for s in rig.names] for kind in ("pan", "tilt", "pan_rate", "tilt_rate")
    }
    pointing = rrb.Vertical(
        _plot(entity_paths.PTU, "Pan [°]", ptu["pan"]),
        _plot(entity_paths.PTU, "Tilt [°]", ptu["tilt"]),
        _plot(entity_paths.PTU, "Pan and tilt rates [°/s]", ptu["pan_rate"] + ptu["tilt_rate"]),
    )
    if not approach:
        return rrb.Horizontal(errors, consistency, pointing)
    return rrb.Horizontal(errors, consistency, pointing, _approach_plots())


def _approach_plots() -> rrb.Container:
    """Deviations from glide path and centre line as needles, and the height over the threshold."""
    return rrb.Vertical(
        _plot(entity_paths.NEEDLES, "Needles: right, up"),
        _plot(entity_paths.THRESHOLD_HEIGHT, "Height, ±2σ [m]"),
    )


def _advice_lane() -> rrb.StateTimelineView:
    return rrb.StateTimelineView(origin=f"/{entity_paths.ADVICE}", name="Advice")
