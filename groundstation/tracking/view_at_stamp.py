"""A camera's share of a triangulation, as of a picture exposed at its stamp, for the rows of a shutter."""

import math

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.detection_messages import Detection
from groundstation.estimation.encoders import HeadRates
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
    rates: HeadRates,
) -> TriangulationView:
    """Return a detection with the angles of its picture's stamp, at which the filter is.

    The pixel is moved back by what the filter's head and target move it until its row is exposed: a millisecond's worth
    of 5 °/s is 0.005°. Of that the head's rate is the uncertain part, which counts as an error of the angles; the rest
    stays what the camera shows, whatever the filter makes of it.
    """
    delay_s = row_delay_s(found.v_px, geometry.image_size_px[1], readout_s)
    return TriangulationView(
        station=geometry,
        pixel=np.array([found.u_px, found.v_px]) - _moved_px(ekf, geometry.name, delay_s),
        covariance_px2=found.covariance_px2,
        pan_rad=angles_rad[0],
        tilt_rad=angles_rad[1],
        angle_sigma_rad=math.hypot(sigma_rad, delay_s * rates.sigma_rad_s),
    )


def _moved_px(ekf: StationEkf, station: str, delay_s: float) -> FloatArray:
    """Return by how much the target's pixel (2,) moves from the stamp to so long after it."""
    if delay_s == 0.0:
        return np.zeros(2)
    stamp, exposed = ekf.predict_pixel(station), ekf.predict_pixel(station, delay_s)
    return np.zeros(2) if stamp is None or exposed is None else exposed.pixel - stamp.pixel
