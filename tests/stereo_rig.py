"""A small synthetic rig and an angle-level flight, shared by the tests of everything after detection."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from groundstation.geometry.camera import Lens
from groundstation.geometry.head_rates import HeadRates
from groundstation.geometry.station import StationGeometry
from groundstation.messages import Epoch, Event, PixelMeasurement, PtuSample
from groundstation.rig.rig import ClockModel, Rig, Station

BASELINE_M = 10.77
FOCAL_PX = 6667.0
STEP_RAD = np.radians(0.00625)
Path = Callable[[float], NDArray[np.float64]]


def standing(station: str) -> HeadRates:
    """Return the rates of a head that stands."""
    return HeadRates(0.0, 0.0, 0.0)


def make_station(name: str, x_m: float, y_m: float = 0.0, *, fixed: bool = False) -> Station:
    return Station(
        name=name,
        fixed=fixed,
        known=("position", "orientation", "lens"),
        ptu_position_m=np.array([x_m, y_m, 1.5]),
        runway_from_base_wxyz=np.array([1.0, 0.0, 0.0, 0.0]),
        head_from_camera_wxyz=np.array([0.5**0.5, -(0.5**0.5), 0.0, 0.0]),
        camera_in_head_m=np.zeros(3),
        lens=Lens(
            image_size_px=(1280, 960),
            focal_px=np.array([FOCAL_PX, FOCAL_PX]),
            principal_point_px=np.array([639.5, 479.5]),
            distortion=np.zeros(5),
        ),
        ptu_resolution_rad=float(STEP_RAD),
        ptu_sigma_rad=0.0,
        ptu_clock=ClockModel(),
        camera_clock=None,
        readout_s=0.0,
        covariance_parameters=(),
        covariance=np.zeros((0, 0)),
    )


def make_rig(names: tuple[str, ...] = ("left", "right"), *, fixed: bool = False) -> Rig:
    places = {"left": (-BASELINE_M / 2, 0.0), "right": (BASELINE_M / 2, 0.0), "third": (40.0, 100.0)}
    return Rig(stations=tuple(make_station(n, *places[n], fixed=fixed) for n in names), path="rig.toml")


def glide(t_s: float, start_y_m: float = 450.0, speed_m_s: float = 25.0) -> NDArray[np.float64]:
    """A straight 3.5° glide towards the stations, weaving a little across."""
    y = start_y_m - speed_m_s * t_s
    return np.array([1.5 * np.sin(2 * np.pi * t_s / 8), y, max(0.3, np.tan(np.radians(3.5)) * (y - 60.0))])


def aim(geometry: StationGeometry, point: NDArray[np.float64]) -> tuple[float, float]:
    """Pan and tilt that put a point near the image's middle."""
    offset = point - geometry.packed[9:12]
    pan, tilt = -np.arctan2(offset[0], offset[1]), np.arctan2(offset[2], np.hypot(offset[0], offset[1]))
    for _ in range(10):
        projection = geometry.project(point, pan, tilt)
        if projection is None:
            return pan, tilt
        error = projection.pixel - geometry.lens.principal_point_px
        if np.abs(error).max() < 1e-6:
            break
        step = np.linalg.solve(projection.jacobian[:, 3:], error)
        pan, tilt = pan - step[0], tilt - step[1]
    return float(pan), float(tilt)


def flight_events(
    rig: Rig,
    path: Path,
    generator: np.random.Generator,
    *,
    duration_s: float = 12.0,
    frame_hz: float = 10.0,
    ptu_hz: float = 50.0,
    pixel_sigma: float = 0.5,
    angle_sigma_rad: float = 0.0,
    exposure_offset_s: dict[str, float] | None = None,
    pan_lag_s: float = 0.2,
) -> Iterator[Event]:
    """Events of a flight as the synchroniser would get them: readings of quantised angles, labelled pixels."""
    geometries = {s.name: s.geometry() for s in rig.stations}
    turning = {s.name for s in rig.stations if not s.fixed}
    offsets = exposure_offset_s or {}

    def angles(name: str, t: float) -> tuple[float, float]:
        return aim(geometries[name], path(t - pan_lag_s)) if name in turning else (0.0, 0.0)

    events: list[tuple[float, int, Event]] = []
    for t in np.arange(-0.313, duration_s + 0.3, 1.0 / ptu_hz):
        for name in turning:
            read = [STEP_RAD * np.round((a + generator.normal(0, angle_sigma_rad)) / STEP_RAD) for a in angles(name, t)]
            events.append((t, 0, PtuSample(t_s=t, station=name, pan_rad=float(read[0]), tilt_rad=float(read[1]))))
    for k, t in enumerate(np.arange(0.0, duration_s, 1.0 / frame_hz)):
        stamps = []
        for s in rig.stations:
            own = t + offsets.get(s.name, 0.0)
            projection = geometries[s.name].project(path(own), *angles(s.name, own))
            if projection is None or not geometries[s.name].contains(projection.pixel):
                continue
            u, v = projection.pixel + generator.normal(0, pixel_sigma, 2)
            events.append((own, 1, PixelMeasurement(t_s=own, station=s.name, epoch=k, u_px=u, v_px=v)))
            stamps.append(own)
        mean = float(np.mean(stamps)) if stamps else float(t)
        events.append((max([mean, *stamps]), 2, Epoch(t_s=mean, epoch=k, stations=rig.names)))
    for _, _, event in sorted(events, key=lambda e: e[:2]):
        yield event


def with_angle_noise(rig: Rig, sigma_rad: float) -> Rig:
    return replace(rig, stations=tuple(replace(s, ptu_sigma_rad=sigma_rad) for s in rig.stations))
