"""`groundstation simulate`: simulate a flight, render its pictures and write a session folder."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from groundstation.errors import ConfigError, ScenarioError
from groundstation.files.toml_table import TomlTable, load_toml, quoted
from groundstation.rig.rig import Rig, load_rig
from groundstation.simulation.airframes.trainer import trainer
from groundstation.simulation.event_faults import Fault, FaultKind
from groundstation.simulation.flights import SPAN_M, FlightModelKind, FlightName, flight, rendered_scenario, site_rig
from groundstation.simulation.optics import Optics
from groundstation.simulation.picture_writer import PictureFormat
from groundstation.simulation.rendered_camera import RenderedCamera
from groundstation.simulation.rendered_scene import RenderedScene
from groundstation.simulation.rendered_session_folder import checked_frames, write_rendered_session
from groundstation.simulation.scenery import Scenery
from groundstation.simulation.session_folder import require_new_folder
from groundstation.simulation.simulate import SimulatedFlight, simulate
from groundstation.simulation.trajectory import Trajectory

MAX_PAIRS = 100_000
_FAULT_KEYS = frozenset({"what", "station", "from_s", "to_s", "by_s", "by_deg"})


@dataclass(frozen=True, slots=True, kw_only=True)
class RenderRequest:
    """Parameters of `render_flight`.

    ``rig`` None is the standard site, ``duration_s`` None the whole flight; ``grey`` cameras are monochrome.
    """

    out: Path
    name: FlightName = FlightName.LANDING
    seed: int = 0
    rate_hz: float = 10.0
    duration_s: float | None = None
    wind_m_s: float = 0.0
    faults: Path | None = None
    rig: Path | None = None
    form: PictureFormat = PictureFormat.JPEG
    grey: bool = False
    aircraft: FlightModelKind = FlightModelKind.WAVES


@dataclass(frozen=True, slots=True, kw_only=True)
class RenderResult:
    """Number of rendered pairs, duration in s, and the folder."""

    pairs: int
    duration_s: float
    out: Path


def render_flight(
    request: RenderRequest, progress: Callable[[int, int], None] = lambda done, total: None
) -> RenderResult:
    """Render one flight into a session folder; ``progress(done, total)`` counts pairs.

    Raises `InputError` where rig, faults or folder are at fault.
    """
    rig = site_rig() if request.rig is None else _usable(request.rig)
    faults = () if request.faults is None else load_faults(request.faults)
    flown = simulate(rendered_scenario(_trajectory(request), rig, seed=request.seed, frame_hz=request.rate_hz))
    pairs = flown.truth.t_s.size
    if pairs > MAX_PAIRS:
        raise ScenarioError("simulate", got=f"{pairs} pairs", wanted=f"at most {MAX_PAIRS}")
    checked_frames(flown, faults)
    # before the surroundings are drawn, which takes some seconds
    require_new_folder(request.out)
    write_rendered_session(
        request.out,
        flown,
        _cameras(request, flown),
        words=_words(request),
        faults=faults,
        form=request.form,
        progress=progress,
    )
    start, end = flown.scenario.trajectory.span_s
    return RenderResult(pairs=pairs, duration_s=end - start, out=request.out)


def _trajectory(request: RenderRequest) -> Trajectory:
    return flight(
        request.name,
        seed=request.seed,
        wind_m_s=request.wind_m_s,
        duration_s=request.duration_s,
        aircraft=request.aircraft,
    )


def _usable(path: Path) -> Rig:
    rig = load_rig(path)
    rig.require_known()
    return rig


def _cameras(request: RenderRequest, flown: SimulatedFlight) -> dict[str, RenderedCamera]:
    """Return a camera for each true station, in one scene."""
    world = RenderedScene(
        trajectory=flown.scenario.trajectory, airframe=trainer(SPAN_M), scenery=Scenery(seed=request.seed)
    )
    optics = Optics(pattern=None) if request.grey else Optics()
    return {
        s.name: RenderedCamera(world, s, optics, seed=request.seed, number=number)
        for number, s in enumerate(flown.scenario.true_rig.stations)
    }


def _words(request: RenderRequest) -> dict[str, str]:
    """Return the top of session.toml."""
    wind = f", wind {request.wind_m_s:g} m/s" if request.wind_m_s else ""
    return {
        "name": f"simulated {request.name}",
        "origin": f"Simulated and rendered, seed {request.seed}{wind}; exact truth",
        "licence": "CC0",
        "notes": "truth.csv and masks.npz hold the truth, without the faults.",
    }


def load_faults(path: Path) -> tuple[Fault, ...]:
    """Read a timetable of faults; raises `ConfigError` with file, row and key of the first mistake."""
    document = load_toml(path, ConfigError)
    top = TomlTable(document, str(path), ConfigError)
    top.refuse_unknown({"fault"})
    rows = document.get("fault", [])
    if not isinstance(rows, list):
        raise top.fail("fault", quoted(rows), "[[fault]] tables")
    return tuple(_fault(TomlTable(row, f"{path}: fault {number + 1}", ConfigError)) for number, row in enumerate(rows))


def _fault(table: TomlTable) -> Fault:
    """Read one [[fault]]."""
    table.refuse_unknown(_FAULT_KEYS)
    kind = FaultKind(table.choice("what", [k.value for k in FaultKind]))
    by = table.number("by_s", 0.0)
    if "by_deg" in table:
        if kind is not FaultKind.PTU_SPIKE:
            raise table.fail("by_deg", quoted(table.values["by_deg"]), "by_s: only a ptu_spike is in degrees")
        by = math.radians(table.number("by_deg"))
    elif kind is FaultKind.PTU_SPIKE:
        raise table.fail("by_deg", "nothing", "how far the readings are off, degrees")
    try:
        return Fault(
            kind=kind,
            station=table.text("station", ""),
            from_s=table.number("from_s"),
            to_s=table.number("to_s") if "to_s" in table else math.inf,
            by=by,
        )
    except ScenarioError as error:
        raise ConfigError(f"{table.where}: {error.where}", got=error.got, wanted=error.wanted) from error
