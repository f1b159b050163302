"""A simulated flight as a plain session folder, which `groundstation replay` reads (docs/formats.md).

The tables hold the data of a real session: stamps in each device's own clock, and the stated rig.
truth.csv is in true session time, so that a replay is judged by what truly happened.
"""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from groundstation.errors import InputError, os_words
from groundstation.files.whole_file import whole_folder
from groundstation.messages import InitialState, PixelMeasurement, PtuSample
from groundstation.rig.rig_toml import rig_to_toml
from groundstation.simulation.device_clocks import device_from_session
from groundstation.simulation.simulate import SimulatedFlight
from groundstation.tracking.config import config_to_toml

Cells = Sequence[str]


def write_session_folder(
    folder: Path, flight: SimulatedFlight, *, name: str, notes: str = "", initial: InitialState | None = None
) -> None:
    """Write session.toml, rig.toml, detections.csv, ptu.csv, truth.csv and, if there are fixes, dgps.csv.

    ``initial`` is the start of a replay; None for a search. Raises `InputError` if the folder cannot be
    written, or is not empty: nothing of a recording is ever replaced.
    """
    origin = f"Simulated at the level of angles and pixels, seed {flight.scenario.seed}; exact truth"
    try:
        with new_session_folder(folder) as draft:
            write_tables(draft, flight, _session(flight, {"name": name, "origin": origin, "notes": notes}, initial))
            write_table(draft / "detections.csv", ["t_s", "station", "u_px", "v_px"], _detections(flight))
    except OSError as fault:
        raise folder_fault(folder, fault) from fault


def require_new_folder(folder: Path) -> None:
    """Raise `InputError` if a folder is there and not empty, or something else is there."""
    if folder.exists() and not folder.is_dir():
        raise InputError(str(folder), got="a file", wanted="a new or an empty folder")
    if folder.is_dir() and any(folder.iterdir()):
        raise InputError(str(folder), got="a folder that is not empty", wanted="a new or an empty one")


@contextmanager
def new_session_folder(folder: Path) -> Iterator[Path]:
    """Yield a draft that becomes the folder once it is whole; raises `InputError` as `require_new_folder` does."""
    require_new_folder(folder)
    with whole_folder(folder) as draft:
        yield draft


def folder_fault(folder: Path, fault: OSError) -> InputError:
    """Build (not raise) the error for a folder that cannot be written."""
    return InputError(str(folder), got=os_words(fault), wanted="a folder that can be written")


def write_tables(folder: Path, flight: SimulatedFlight, session: dict[str, Any]) -> None:
    """Write session.toml, rig.toml, ptu.csv, truth.csv and dgps.csv, but not what the cameras saw."""
    _write_text(folder / "session.toml", config_to_toml(session) + "\n")
    _write_text(folder / "rig.toml", rig_to_toml(flight.rig))
    turning = [s.name for s in flight.rig.stations if not s.fixed]
    if turning:
        columns = ["t_s", *(f"{n}_{axis}_deg" for n in turning for axis in ("pan", "tilt"))]
        write_table(folder / "ptu.csv", columns, _readings(flight, turning))
    pixels = [f"{n}_{axis}_px" for n in flight.rig.names for axis in "uv"]
    write_table(folder / "truth.csv", ["t_s", "x_m", "y_m", "z_m", *pixels], _truth(flight))
    if flight.dgps:
        sigmas = ["sigma_x_m", "sigma_y_m", "sigma_z_m"]
        write_table(folder / "dgps.csv", ["t_s", "x_m", "y_m", "z_m", *sigmas, "status"], _fixes(flight))


def _session(flight: SimulatedFlight, words: dict[str, Any], initial: InitialState | None) -> dict[str, Any]:
    """Return session.toml as tables of plain values."""
    tables = dict(words)
    if target := target_table(flight):
        tables["target"] = target
    if initial is not None:
        tables["initial"] = {
            "t_s": float(initial.t_s),
            "position_m": initial.position_runway_m.tolist(),
            "velocity_m_s": initial.velocity_runway_m_s.tolist(),
            "sigma_position_m": initial.sigma_position_m.tolist(),
            "sigma_velocity_m_s": initial.sigma_velocity_m_s.tolist(),
        }
    return tables


def target_table(flight: SimulatedFlight) -> dict[str, Any]:
    """Return what [target] of session.toml has of the receiver's antenna; empty where it is at the nose."""
    dgps = flight.scenario.dgps
    if dgps is None or not np.any(dgps.antenna_in_body_m):
        return {}
    return {"antenna_in_body_m": dgps.antenna_in_body_m.tolist()}


def _detections(flight: SimulatedFlight) -> Iterable[Cells]:
    """Return the pixels by their stamps in each camera's own clock."""
    pixels = [event for event in flight.events if isinstance(event, PixelMeasurement)]
    for pixel in sorted(pixels, key=lambda p: p.t_s):
        stamp = device_from_session(flight.rig[pixel.station].camera_clock, np.array(pixel.t_s))
        yield [stamp_text(float(stamp)), pixel.station, f"{pixel.u_px:.6f}", f"{pixel.v_px:.6f}"]


def _readings(flight: SimulatedFlight, turning: Sequence[str]) -> Iterable[Cells]:
    """Return the readings by their stamps; units with equal stamps share a row."""
    rows: dict[str, dict[str, PtuSample]] = {}
    for event in flight.events:
        if isinstance(event, PtuSample):
            stamp = device_from_session(flight.rig[event.station].ptu_clock, np.array(event.t_s))
            rows.setdefault(stamp_text(float(stamp)), {})[event.station] = event
    for at in sorted(rows, key=float):
        cells = [at]
        for name in turning:
            sample = rows[at].get(name)
            angles = () if sample is None else np.degrees([sample.pan_rad, sample.tilt_rad])
            cells += [f"{angle:.9f}" for angle in angles] or ["", ""]
        yield cells


def _truth(flight: SimulatedFlight) -> Iterable[Cells]:
    """Return where the target truly was and is seen; a pixel outside the image is two empty cells."""
    truth = flight.truth
    for k, (t_s, position) in enumerate(zip(truth.t_s, truth.position_runway_m, strict=True)):
        cells = [stamp_text(float(t_s)), *(f"{value:.6f}" for value in position)]
        for name in flight.rig.names:
            station = truth.stations[name]
            cells += [f"{value:.6f}" for value in station.pixel_px[k]] if station.visible[k] else ["", ""]
        yield cells


def _fixes(flight: SimulatedFlight) -> Iterable[Cells]:
    """Return the fixes in the DGPS clock."""
    for fix in flight.dgps:
        sigmas = ["", "", ""] if fix.sigma_m is None else [f"{sigma:.6f}" for sigma in fix.sigma_m]
        yield [stamp_text(fix.t_s), *(f"{value:.6f}" for value in fix.position_runway_m), *sigmas, fix.status]


def stamp_text(t_s: float) -> str:
    """Format a stamp to 0.1 µs; zero has no sign."""
    text = f"{t_s:.7f}"
    return text if float(text) else text.lstrip("-")


def write_table(path: Path, columns: Sequence[str], rows: Iterable[Cells]) -> None:
    """Write one CSV table; no cell of ours needs quoting."""
    _write_text(path, "".join(",".join(cells) + "\n" for cells in [columns, *rows]))


def _write_text(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8", newline="\n")
