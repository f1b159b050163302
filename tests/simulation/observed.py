"""Reading a simulated flight as a plain user would: pixels and angles of each pair, triangulated."""

import numpy as np

from groundstation.estimation.triangulation import TriangulationView, triangulate
from groundstation.geometry.angles import wrap_rad
from groundstation.messages import Epoch, PixelMeasurement, PtuSample
from groundstation.simulation import SimulatedFlight


def triangulated(flight: SimulatedFlight) -> tuple[np.ndarray, np.ndarray]:
    """By the stated rig and the stamps as they are: epochs' stamps (n,) and points (n, 3), NaN where there is none.

    Angles are interpolated between the readings; a fixed station's are zero.
    """
    angles = {}
    for name in flight.rig.names:
        mine = sorted((e for e in flight.events if isinstance(e, PtuSample) and e.station == name), key=lambda e: e.t_s)
        angles[name] = np.array([[e.t_s, wrap_rad(e.pan_rad), e.tilt_rad] for e in mine]).reshape(-1, 3)
    epochs = [e for e in flight.events if isinstance(e, Epoch)]
    views: dict[int, list[TriangulationView]] = {}
    for event in flight.events:
        if not isinstance(event, PixelMeasurement):
            continue
        table, pan, tilt = angles[event.station], 0.0, 0.0
        if len(table):
            pan, tilt = (float(np.interp(event.t_s, table[:, 0], table[:, k])) for k in (1, 2))
        view = TriangulationView(
            station=flight.rig[event.station].geometry(),
            pixel=np.array([event.u_px, event.v_px]),
            pan_rad=pan,
            tilt_rad=tilt,
            covariance_px2=np.eye(2),
            angle_sigma_rad=1e-5,
        )
        views.setdefault(event.epoch, []).append(view)
    points = np.full((len(epochs), 3), np.nan)
    for k, epoch in enumerate(epochs):
        point = triangulate(views[epoch.epoch]) if len(views.get(epoch.epoch, [])) > 1 else None
        if point is not None:
            points[k] = point.point_runway_m
    return np.array([e.t_s for e in epochs]), points
