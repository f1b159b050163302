"""A camera's share of a triangulation, as of a picture exposed at its stamp, for the rows of a shutter."""

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.detection_messages import Detection
from groundstation.estimation.station_ekf import StationEkf
from groundstation.estimation.triangulation import TriangulationView
from groundstation.geometry.rolling_shutter import row_delay_s
from groundstation.geometry.station import StationGeometry


def view_at_stamp(
    ekf: StationEkf,
    geometry: StationGeometry,
    found: Detection,
    angles_rad: tuple[float, float],
    sigma_rad: float,
    readout_s: float,
) -> TriangulationView:
    """Return a detection with the angles of its picture's stamp, at which the filter is.

    The pixel is moved back by what the filter's head and target move it until its row is exposed: a millisecond's worth
    of 5 °/s is 0.005°. What the filter does not know of that motion is an error of the pixel; the rest stays what
    the camera shows, whatever the filter makes of it.
    """
    delay_s = row_delay_s(found.v_px, geometry.image_size_px[1], readout_s)
    moved_px, covariance_px2 = _moved_px(ekf, geometry, delay_s)
    return TriangulationView(
        station=geometry,
        pixel=np.array([found.u_px, found.v_px]) - moved_px,
        covariance_px2=found.covariance_px2 + covariance_px2,
        pan_rad=angles_rad[0],
        tilt_rad=angles_rad[1],
        angle_sigma_rad=sigma_rad,
    )


def _moved_px(ekf: StationEkf, geometry: StationGeometry, delay_s: float) -> tuple[FloatArray, FloatArray]:
    """Return by how much the target's pixel (2,) moves from the stamp to so long after it, with its covariance (2, 2).

    The covariance is that of the target's velocity and the head's rates. Errors of place and angles are left out: they
    change the difference of the two pixels by a small share of what they change either by.
    """
    if delay_s == 0.0:
        return np.zeros(2), np.zeros((2, 2))
    station = geometry.name
    stamp, exposed = ekf.predict_pixel(station), ekf.predict_pixel(station, delay_s)
    if stamp is None or exposed is None:
        return np.zeros(2), np.zeros((2, 2))
    rates = ekf.layout.rates.get(station, slice(0, 0))
    moving = np.r_[ekf.layout.velocity, rates]
    J = (exposed.jacobian - stamp.jacobian)[:, moving]
    return exposed.pixel - stamp.pixel, J @ ekf.covariance[np.ix_(moving, moving)] @ J.T
