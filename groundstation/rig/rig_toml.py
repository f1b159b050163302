"""Writing a rig as the text of rig.toml, which `groundstation.rig.rig.load_rig` reads."""

import json
from collections.abc import Iterable

import numpy as np

from groundstation.rig.covariance import ParameterCovariance
from groundstation.rig.dgps import RigReference
from groundstation.rig.ptu_axes import IDEAL_AXES, axes_to_toml
from groundstation.rig.rig import PARTS, RIG_FORMAT, ClockModel, Rig, Station


def rig_to_toml(rig: Rig) -> str:
    """Return the text of a rig file; lengths in m, angles in degrees, as in docs/formats.md."""
    parts = [f'format = "{RIG_FORMAT}"', *(_station(station) for station in rig.stations)]
    if rig.shared_covariance.names:
        parts.append("\n".join(_covariance("covariance", rig.shared_covariance)))
    if rig.reference is not None:
        parts.append("\n".join(_reference(rig.reference)))
    return "\n\n".join(parts) + "\n"


def _reference(reference: RigReference) -> list[str]:
    """Return the table [reference] of the DGPS."""
    lines = ["[reference]"]
    if reference.session:
        lines.append(f"session = {json.dumps(reference.session)}")
    if reference.offset_s is not None:
        numbers = f"offset_s = {float(reference.offset_s)!r}, sigma_s = {float(reference.offset_sigma_s)!r}"
        lines.append(f"dgps_clock = {{ {numbers} }}")
    if reference.antenna_in_body_m is not None:
        lines.append(f"antenna_in_body_m = {_list(reference.antenna_in_body_m)}")
        if reference.antenna_sigma_m is not None:
            lines.append(f"antenna_sigma_m = {_list(reference.antenna_sigma_m)}")
    return lines


def _station(station: Station) -> str:
    """Return one [[station]] table; uncalibrated parts are left out."""
    lines = ["[[station]]", f'name = "{station.name}"', f"fixed = {str(station.fixed).lower()}"]
    if set(station.known) != set(PARTS):
        lines.append("known = [" + ", ".join(f'"{part}"' for part in station.known) + "]")
    if "position" in station.known:
        lines.append(f"ptu_position_m = {_list(station.ptu_position_m)}")
    if "orientation" in station.known:
        lines.append(f"runway_from_base_wxyz = {_list(station.runway_from_base_wxyz)}")
        lines.append(f"head_from_camera_wxyz = {_list(station.head_from_camera_wxyz)}")
    lines.append(f"camera_in_head_m = {_list(station.camera_in_head_m)}")
    if "lens" in station.known:
        w, h = station.lens.image_size_px
        lines += [
            f"image_size_px = [{w}, {h}]",
            f"focal_px = {_list(station.lens.focal_px)}",
            f"principal_point_px = {_list(station.lens.principal_point_px)}",
            f"distortion = {_list(station.lens.distortion)}",
        ]
    # fifteen digits hide the rounding error of the conversion to radians and back
    lines.append(f"ptu_resolution_deg = {np.degrees(station.ptu_resolution_rad):.15g}")
    lines.append(f"ptu_sigma_deg = {np.degrees(station.ptu_sigma_rad):.15g}")
    if station.ptu_axes != IDEAL_AXES:
        lines.append(f"ptu_axes = {axes_to_toml(station.ptu_axes)}")
    if station.ptu_clock_given or station.ptu_clock != ClockModel():
        lines.append(f"ptu_clock = {_clock(station.ptu_clock)}")
    if station.camera_clock is not None:
        lines.append(f"camera_clock = {_clock(station.camera_clock)}")
    lines.append(f"readout_s = {float(station.readout_s)!r}")
    if station.readout_sigma_s > 0.0:
        lines.append(f"readout_sigma_s = {float(station.readout_sigma_s)!r}")
    if station.covariance_parameters:
        known = ParameterCovariance(names=station.covariance_parameters, matrix=station.covariance)
        lines += _covariance("station.covariance", known)
    return "\n".join(lines)


def _covariance(table: str, known: ParameterCovariance) -> list[str]:
    names = ", ".join(f'"{name}"' for name in known.names)
    rows = ", ".join(_list(row) for row in known.matrix)
    return [f"[{table}]", f"parameters = [{names}]", f"matrix = [{rows}]"]


def _list(values: Iterable[float]) -> str:
    return "[" + ", ".join(repr(float(value)) for value in values) + "]"


def _clock(clock: ClockModel) -> str:
    numbers = f"offset_s = {float(clock.offset_s)!r}, drift_ppm = {float(clock.drift_ppm)!r}"
    return f"{{ {numbers}, sigma_s = {float(clock.sigma_s)!r} }}"
