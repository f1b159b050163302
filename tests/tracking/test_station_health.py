"""Stations are judged by a confirmed target only."""

import numpy as np

from groundstation.estimation.config import EstimationConfig
from groundstation.estimation.station_ekf import StationEkf
from groundstation.estimation.triangulation import TriangulationView
from groundstation.geometry.station import StationGeometry
from groundstation.integrity.station_exclusion import IntegrityConfig, StationVerdict
from groundstation.messages import TrackEvent
from groundstation.tracking.epoch_buffer import EpochView, EpochViews
from groundstation.tracking.station_health import StationHealth
from tests.stereo_rig import aim, make_rig

AT = np.array([0.0, 200.0, 8.0])
OFF_PX = np.array([0.0, 40.0])


def view(geometry: StationGeometry, station: str, t_s: float, off_px: np.ndarray) -> EpochView:
    pan, tilt = aim(geometry, AT)
    projection = geometry.project(AT, pan, tilt)
    assert projection is not None
    seen = TriangulationView(
        station=geometry,
        pixel=projection.pixel + off_px,
        covariance_px2=np.eye(2),
        pan_rad=pan,
        tilt_rad=tilt,
        angle_sigma_rad=1e-5,
    )
    return EpochView(t_s=t_s, epoch=0, station=station, view=seen, accepted=True, labelled=False)


def test_a_target_that_is_not_confirmed_tells_nothing_of_stations() -> None:
    """Expected: rays that miss each other by 40 px are of a fault once the target is confirmed.

    Before, they may be of different things, as found in validate world 8: with four stations the one that was right was
    left out, and the track was 180 m off.
    """
    rig = make_rig()
    geometries = {s.name: s.geometry() for s in rig.stations}
    ekf = StationEkf(geometries, rig.names, EstimationConfig())
    ekf.predict_to(0.0)
    ekf.start_target(AT, np.zeros(3), np.diag([0.01, 0.25, 0.01, 0.01, 0.01, 0.01]))
    for name, geometry in geometries.items():
        ekf.update_encoder(name, aim(geometry, AT), 1e-5, 0.0, 0.0)
    health = StationHealth(geometries, ekf, IntegrityConfig())

    def judged(first: int, confirmed: bool) -> list[TrackEvent]:
        told = []
        for k in range(first, first + 60):
            t_s = 0.1 * k
            seen = [view(g, n, t_s, OFF_PX if n == "left" else np.zeros(2)) for n, g in geometries.items()]
            views = EpochViews(views=tuple(seen), accepted=frozenset(geometries), arrived_s=None)
            told += health.epoch(t_s, views, confirmed=confirmed)
        return told

    assert not judged(0, confirmed=False)
    assert {health.monitor.verdict(name) for name in geometries} == {StationVerdict.TRUSTED}
    assert judged(60, confirmed=True)
    assert health.monitor.verdict("left") is not StationVerdict.TRUSTED
