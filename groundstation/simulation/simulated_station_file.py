"""The rig file and the station file of a simulated station; its devices' URLs are links made by the simulator."""

from dataclasses import replace
from pathlib import Path

from groundstation.live.head_device import HeadDevice
from groundstation.live.reference_device import ReferenceDevice
from groundstation.live.station_file import StationDevices, StationFile
from groundstation.pointing.pointing_law import PointingConfig
from groundstation.pointing.search_pattern import SearchConfig
from groundstation.rig.ptu_axes import PtuAxes
from groundstation.rig.rig import ClockModel, Rig
from groundstation.rig.rig_toml import rig_to_toml
from groundstation.simulation.repeated_landings import SPAN_M
from groundstation.simulation.simulated_receiver import SIMULATED_ORIGIN, SIMULATED_SEPARATION_M
from groundstation.simulation.standard_cases import standard_rig

# the simulator shares a busy computer with the renderer: its units may be silent for longer than true ones
_PATIENCE_S = 30.0


def simulated_station_file(folder: Path, rate_hz: float, rig: Rig | None, *, dgps: bool = False) -> StationFile:
    """Write the rig file of a simulated station and return its station file; device URLs are links in ``folder``.

    ``dgps`` adds a reference receiver on the aircraft's nose.
    """
    folder.mkdir(parents=True, exist_ok=True)
    rig = standard_rig() if rig is None else _with_simulated_devices(rig)
    path = folder / "rig.toml"
    path.write_text(rig_to_toml(rig), encoding="utf-8")
    return StationFile(
        path=folder / "station.toml",
        name="simulated range",
        rig=path,
        config=None,
        rate_hz=rate_hz,
        span_m=SPAN_M,
        record=folder,
        pointing=PointingConfig(),
        search=SearchConfig(),
        stations=tuple(
            StationDevices(
                name=s.name,
                camera="simulated",
                camera_settings={},
                head=None if s.fixed else _head(folder / f"ptu-{s.name}"),
            )
            for s in rig.stations
        ),
        reference=ReferenceDevice(url=str(folder / "dgps")) if dgps else None,
        origin=SIMULATED_ORIGIN,
        geoid_separation_m=SIMULATED_SEPARATION_M,
        antenna_in_body_m=(0.0, 0.0, 0.0) if dgps else None,
        # no solar keep-out: rendered cameras cannot be damaged, and the simulation has no time of day
        sun_angle_rad=0.0,
    )


def _with_simulated_devices(rig: Rig) -> Rig:
    """Return a rig for the simulated devices: no lag, no drift, and of the heads' errors the quantum and the lean."""
    stations = tuple(
        replace(
            station,
            ptu_clock=ClockModel(sigma_s=station.ptu_clock.sigma_s),
            camera_clock=station.camera_clock and ClockModel(sigma_s=station.camera_clock.sigma_s),
            ptu_axes=PtuAxes(lean_rad=station.ptu_axes.lean_rad),
        )
        for station in rig.stations
    )
    return replace(rig, stations=stations)


def _head(link: Path) -> HeadDevice:
    return HeadDevice(url=str(link), baud=115200, options={"patience_s": _PATIENCE_S})
