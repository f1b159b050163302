"""Several runs in one view: a common runway, pictures of each run, errors and consistency overlaid."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from groundstation.arrays import FloatArray
from groundstation.viewer import entity_paths
from groundstation.viewer.blueprint import EYE_FROM_MIDDLE, MAX_NIS_SHOWN, TARGET_FROM_MIDDLE
from groundstation.viewer.merge_recordings import RecordedTrack, RunAlignment, read_track, send_run
from groundstation.viewer.recording_file import written_recording
from groundstation.viewer.scene import EXPECTED_RANGE_M

APPLICATION = "groundstation"
RUNS = "runs"
EVENT_LOG = f"{RUNS}/log"
EVENT_LINE = f"{RUNS}/event"
_LINE_WIDTH_S = 1e-3
# apart for eyes without one kind of cone, too: by lightness where the hue does not tell
RUN_COLOURS = (
    entity_paths.EKF_COLOUR,
    entity_paths.Colour((233, 130, 20)),
    entity_paths.Colour((200, 140, 183)),
    entity_paths.Colour((191, 220, 150)),
    entity_paths.Colour((151, 90, 255)),
    entity_paths.Colour((200, 69, 77)),
)
_COLOUR_NAMES = ("cyan", "orange", "pink", "light green", "violet", "red")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ComparedRun:
    """One run of a view: name, recording, track, and the shift of its times in s."""

    name: str
    path: Path
    track: RecordedTrack
    shift_s: float


def read_runs(recordings: Mapping[str, Path], align: RunAlignment) -> list[ComparedRun]:
    """Read the tracks and shift them to a common event time (`event_at`); `RunAlignment.NONE` shifts nothing.

    A run without an estimate is aligned by its first picture. Raises `InputError` for a recording of another format.
    """
    tracks = {name: read_track(path) for name, path in recordings.items()}
    # Rerun draws no JPEG picture at a time below 0: the event is as many whole seconds on as the longest run-up takes
    at_s = float(math.ceil(max(0.0, *(t.event_s(align) - t.span_s[0] for t in tracks.values()))))
    return [
        ComparedRun(
            name=name,
            path=recordings[name],
            track=track,
            shift_s=0.0 if align is RunAlignment.NONE else at_s - track.event_s(align),
        )
        for name, track in tracks.items()
    ]


def event_at(runs: Sequence[ComparedRun], align: RunAlignment) -> float | None:
    """Return the common time of the event in s; None without alignment."""
    return None if align is RunAlignment.NONE else runs[0].track.event_s(align) + runs[0].shift_s


def event_text(runs: Sequence[ComparedRun], align: RunAlignment) -> str:
    """Return the description of the event; a track may lack a touchdown, and a run may lack a track."""
    if align is RunAlignment.TOUCHDOWN:
        rest = [run.name for run in runs if not run.track.touches_down]
        if rest and len(rest) == len(runs):
            return "lowest height (within 0.5 m; no touchdown)"
        if rest:
            return f"touchdown (of {', '.join(rest)}, without one, the lowest height)"
    return align.value


def overlap_in_time(runs: Sequence[ComparedRun]) -> bool:
    """Return whether the tracks overlap in time without a shift."""
    return max(r.track.start_s for r in runs) <= min(r.track.end_s for r in runs)


def write_comparison(path: Path, runs: Sequence[ComparedRun], align: RunAlignment) -> None:
    """Write one recording with all runs, each under its name; raises `InputError` if it cannot be written."""
    with written_recording(path, APPLICATION, " and ".join(run.name for run in runs)) as stream:
        _log_runs(stream, runs, align)


def _log_runs(stream: rr.RecordingStream, runs: Sequence[ComparedRun], align: RunAlignment) -> None:
    stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    longest = max(range(len(runs)), key=lambda k: float(runs[k].track.position_runway_m[:, 1].max(initial=-np.inf)))
    for number, run in enumerate(runs):
        send_run(stream, run.path, run.name, run.shift_s, runway=number == longest)
        _log_run_styles(stream, run, _colour(number))
    stream.log(RUNS, rr.TextDocument(_description(runs, align), media_type=rr.MediaType.MARKDOWN), static=True)
    at_s = event_at(runs, align)
    if at_s is not None:
        _log_event(stream, at_s, f"{event_text(runs, align)} of each run")
    stream.send_blueprint(comparison_blueprint(runs))


def _log_event(stream: rr.RecordingStream, at_s: float, name: str) -> None:
    """Mark the event of the alignment: an entry in the log, and a vertical line in the NIS plot."""
    stream.set_time(entity_paths.TIMELINE, duration=at_s)
    stream.log(EVENT_LOG, rr.TextLog(name, level=rr.TextLogLevel.INFO))
    style = rr.SeriesLines(colors=entity_paths.BOUND_COLOUR, names=name, widths=1.5)
    stream.log(EVENT_LINE, style, static=True)
    for k, value in enumerate((0.0, MAX_NIS_SHOWN)):
        stream.set_time(entity_paths.TIMELINE, duration=at_s + k * _LINE_WIDTH_S)
        stream.log(EVENT_LINE, rr.Scalars(value))
    stream.reset_time()


def _log_run_styles(stream: rr.RecordingStream, run: ComparedRun, colour: entity_paths.Colour) -> None:
    """Log the colour and name of a run, which replace the style that all runs share."""
    styles: dict[str, rr.AsComponents] = {
        entity_paths.EKF: rr.Points3D.from_fields(colors=colour, radii=rr.Radius.ui_points(6.0)),
        entity_paths.EKF_NAME: rr.Points3D.from_fields(
            colors=entity_paths.LABEL_COLOUR, radii=rr.Radius.ui_points(0.0), labels=[run.name], show_labels=True
        ),
        entity_paths.EKF_ELLIPSOID: rr.Ellipsoids3D.from_fields(colors=colour),
        entity_paths.EKF_ELLIPSOIDS: rr.Ellipsoids3D.from_fields(colors=(*colour, 110)),
        entity_paths.PAIR_LATENCY: rr.SeriesLines(colors=colour, names=run.name, widths=1.5),
    }
    if run.track.has_errors:
        for axis in entity_paths.AXES:
            styles[f"{entity_paths.ERROR}/{axis}"] = rr.SeriesLines(
                colors=[colour, entity_paths.dimmed(colour), entity_paths.dimmed(colour)],
                names=[run.name, f"{run.name} +2σ", f"{run.name} −2σ"],
                widths=[1.8, 1.0, 1.0],
            )
    for station in run.track.stations:
        styles[f"{entity_paths.NIS}/{station}"] = rr.SeriesPoints(
            colors=colour, names=f"{run.name} {station}", markers="circle", marker_sizes=1.5
        )
    for entity, style in styles.items():
        stream.log(f"{run.name}/{entity}", style, static=True)


def _description(runs: Sequence[ComparedRun], align: RunAlignment) -> str:
    """Return the legend: the colour of each run and the shift of its times."""
    rows = [
        f"| **{run.name}** | {_COLOUR_NAMES[k % len(_COLOUR_NAMES)]} | "
        f"{f'{run.track.start_s:.2f}' if len(run.track) else 'none'} | {run.shift_s:+.2f} |"
        for k, run in enumerate(runs)
    ]
    at_s = event_at(runs, align)
    at = "each in its own time" if at_s is None else f"each one's {event_text(runs, align)} is at {at_s:.0f} s"
    return "\n".join(
        [f"One runway frame; {at}.", "", "| run | colour | track from, s | moved by, s |", "|--|--|--|--|", *rows]
    )


def _colour(number: int) -> entity_paths.Colour:
    return RUN_COLOURS[number % len(RUN_COLOURS)]


def comparison_blueprint(runs: Sequence[ComparedRun]) -> rrb.Blueprint:
    """Return the layout: the runway with all tracks, the overlaid plots, and a column of pictures for each run."""
    points = np.concatenate([r.track.position_runway_m for r in runs])
    # without any track, the strip up to where one is to be expected
    shown = points if len(points) else np.array([[0.0, 0.0, 0.0], [0.0, EXPECTED_RANGE_M, 0.0]])
    scene = _scene(runs, np.minimum(shown.min(axis=0), 0.0), shown.max(axis=0))
    plotted = any(run.track.has_plots for run in runs)
    left = rrb.Vertical(scene, _plots(runs), row_shares=[6, 5]) if plotted else rrb.Vertical(scene)
    pictures = [_pictures(run) for run in runs if run.track.stations]
    words = rrb.TextDocumentView(origin=f"/{RUNS}", name="Runs")
    states = [
        rrb.StateTimelineView(origin=f"/{run.name}/{entity_paths.STATUS}", name=f"Status: {run.name}") for run in runs
    ]
    contents = [f"+ /{EVENT_LOG}", *(f"+ /{run.name}/{entity_paths.LOG}/**" for run in runs)]
    logs = rrb.TextLogView(origin="/", contents=contents, name="Log")
    below = rrb.Horizontal(words, rrb.Tabs(*states, logs), column_shares=[1, 1])
    right = rrb.Vertical(rrb.Horizontal(*pictures), below, row_shares=[3, 1]) if pictures else below
    start_s = min(r.track.start_s + r.shift_s for r in runs)
    end_s = max(r.track.end_s + r.shift_s for r in runs)
    loop = rrb.components.AbsoluteTimeRange(min=rr.TimeInt(seconds=start_s), max=rr.TimeInt(seconds=end_s))
    return rrb.Blueprint(
        rrb.Horizontal(left, right, column_shares=[1, 1] if pictures else [3, 2]),
        rrb.TopPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(
            state="collapsed",
            timeline=entity_paths.TIMELINE,
            play_state="Playing",
            loop_mode="Selection",
            time_selection=loop,
        ),
        auto_layout=False,
        auto_views=False,
    )


def _scene(runs: Sequence[ComparedRun], low_m: FloatArray, high_m: FloatArray) -> rrb.Spatial3DView:
    """The runway with every track in the run's colour; entities that would overlap are hidden."""
    middle, length = (low_m + high_m) / 2, float(np.linalg.norm(high_m - low_m))
    so_far = rrb.VisibleTimeRanges(
        timeline=entity_paths.TIMELINE,
        start=rrb.TimeRangeBoundary.infinite(),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )
    contents: list[str] = []
    overrides: dict[Any, Any] = {}
    for number, run in enumerate(runs):
        contents += [f"+ /{run.name}/world/**", f"+ /{run.name}/{entity_paths.AIRCRAFT}/**"]
        # a label that stands at the same place twice cannot be read
        contents += [f"- /{run.name}/{entity_paths.STATIONS}/{s}/name" for s in run.track.stations if number]
        contents.append(f"- /{run.name}/{entity_paths.TRIANGULATION}")
        path = rr.LineStrips3D.from_fields(colors=_colour(number), radii=rr.Radius.ui_points(2.2))
        overrides[f"{run.name}/{entity_paths.EKF_PATH}"] = [path, so_far]
        overrides[f"{run.name}/{entity_paths.EKF_ELLIPSOIDS}"] = [so_far]
    return rrb.Spatial3DView(
        origin="/",
        contents=contents,
        name="Runway",
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=middle + length * EYE_FROM_MIDDLE,
            look_target=middle + TARGET_FROM_MIDDLE * (high_m - low_m) * [0.0, 1.0, 0.0],
            eye_up=[0.0, 0.0, 1.0],
        ),
        background=entity_paths.BACKGROUND,
        line_grid=rrb.LineGrid3D(visible=True, spacing=10.0, color=[120, 120, 120, 50]),
        overrides=overrides,
    )


def _pictures(run: ComparedRun) -> rrb.Container:
    """One run's pictures, one below the other."""
    views = [
        rrb.Spatial2DView(origin=f"/{run.name}/{entity_paths.image(s)}", name=f"{run.name}: {s}")
        for s in run.track.stations
    ]
    return rrb.Vertical(*views)


def _plots(runs: Sequence[ComparedRun]) -> rrb.Container:
    """Errors of each axis, consistency and delay, all runs in the same plot."""
    errors = [
        _plot([f"{run.name}/{entity_paths.ERROR}/{axis}" for run in runs], f"{axis}: error, ±2σ [m]")
        for axis in entity_paths.AXES
    ]
    nis = [f"{run.name}/{entity_paths.NIS}/{s}" for run in runs for s in run.track.stations]
    bounds = [f"{run.name}/{entity_paths.NIS_BOUNDS}" for run in runs]
    consistency = [
        _plot([*nis, *bounds, EVENT_LINE], "NIS and 95 % bounds", top=MAX_NIS_SHOWN),
        _plot([f"{run.name}/{entity_paths.PAIR_LATENCY}" for run in runs], "Latency of a pair [ms]"),
    ]
    shown = any(run.track.has_errors for run in runs)
    return rrb.Horizontal(rrb.Vertical(*errors), rrb.Vertical(*consistency)) if shown else rrb.Horizontal(*consistency)


def _plot(entities: Iterable[str], name: str, top: float | None = None) -> rrb.TimeSeriesView:
    axis = None if top is None else rrb.ScalarAxis(range=(0.0, top), zoom_lock=True)
    return rrb.TimeSeriesView(
        origin="/",
        contents=[f"+ /{entity}" for entity in entities],
        name=name,
        axis_y=axis,
        plot_legend=rrb.PlotLegend(visible=False),
    )
