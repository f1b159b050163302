"""Outputs of the pipeline as lines of JSON, bit-exact, without processing times."""

from typing import Any

from groundstation.arrays import FloatArray
from groundstation.messages import CameraReport, Detection, TrackEstimate, TrackState


def estimate_values(estimate: TrackEstimate) -> dict[str, Any]:
    """Return an estimate as plain values, which do not depend on the processing time."""
    k, t = estimate.kinematics, estimate.triangulation
    return {
        "epoch": int(estimate.epoch),
        "t_s": float(estimate.t_s),
        "status": estimate.status.value,
        "position_runway_m": None if k is None else k.position_runway_m.tolist(),
        "velocity_runway_m_s": None if k is None else k.velocity_runway_m_s.tolist(),
        "covariance": None if k is None else k.covariance.tolist(),
        "triangulation_status": estimate.triangulation_status.value,
        "triangulation": None
        if t is None
        else {
            "midpoint_runway_m": t.midpoint_runway_m.tolist(),
            "point_runway_m": t.point_runway_m.tolist(),
            "covariance_m2": t.covariance_m2.tolist(),
            "gap_m": float(t.gap_m),
            "residual_sigma": float(t.residual_sigma),
        },
    }


def state_values(state: TrackState) -> dict[str, Any]:
    """Return the output of a heartbeat as plain values."""
    k = state.kinematics
    return {
        "t_s": float(state.t_s),
        "status": state.status.value,
        "position_runway_m": None if k is None else k.position_runway_m.tolist(),
        "velocity_runway_m_s": None if k is None else k.velocity_runway_m_s.tolist(),
        "covariance": None if k is None else k.covariance.tolist(),
    }


def camera_values(camera: CameraReport) -> dict[str, Any]:
    """Return one camera's report as plain values; of a silhouette its box, not its outline."""
    found, roi, innovation = camera.result, camera.roi, camera.innovation
    values: dict[str, Any] = {
        "epoch": int(camera.epoch),
        "t_s": float(camera.t_s),
        "station": camera.station,
        "status": camera.status.value,
        "roi": None if roi is None else [roi.x0, roi.y0, *roi.size],
        "predicted_px": _plain(camera.predicted_px),
        "predicted_covariance_px2": _plain(camera.predicted_covariance_px2),
        "pan_rad": camera.pan_rad if camera.pan_rad is None else float(camera.pan_rad),
        "tilt_rad": camera.tilt_rad if camera.tilt_rad is None else float(camera.tilt_rad),
    }
    if isinstance(found, Detection):
        values["u_px"], values["v_px"] = float(found.u_px), float(found.v_px)
        values["covariance_px2"] = found.covariance_px2.tolist()
        values["box"] = [float(v) for v in (found.box.x0, found.box.y0, *found.box.size)]
        values["contrast_to_noise"], values["channel"] = float(found.contrast_to_noise), found.channel
    else:
        values["miss"], values["detail"] = found.reason.value, found.detail
    if innovation is not None:
        values["innovation_px"], values["nis"] = innovation.residual.tolist(), float(innovation.nis)
    return values


def _plain(array: FloatArray | None) -> Any:
    return None if array is None else array.tolist()
