"""What each fault does to the pixels of one pair, to the position, and to the residuals that are left.

Let y (2N,) be the pixels of N stations against those of the estimate, W their weight, H (2N, 3) their Jacobian by the
target's position, and E_f (2N, 3) that of the parameters of fault f in units of its size. The fix follows a fault by
S_f = (Hᵀ W H)⁻¹ Hᵀ W E_f; M = W − W H (Hᵀ W H)⁻¹ Hᵀ W removes from the residuals what a displaced target explains, and
leaves A_f = E_fᵀ M E_f of the information on the fault (Joerger, Chan and Pervan 2014, parity space). A direction of a
fault without information in A_f is one that the residuals cannot see: with two stations everything in the plane of the
two rays, range above all; with any number of them a displaced target point.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.estimation.parameters import ParameterPrior, rig_prior
from groundstation.geometry.calibration import CALIBRATION_PARAMETERS, parameter_indices, project_with_calibration
from groundstation.geometry.head_rates import HeadRates
from groundstation.geometry.rolling_shutter import row_delay_s
from groundstation.geometry.station import StationGeometry
from groundstation.landing_site.fault_table import FaultHypothesis, FaultTable, StationFault
from groundstation.landing_site.runway import LandingRunway
from groundstation.rig.rig import Rig

# parameters of a fault: two of the picture or of the axes, one of a clock, three of the target point
DIRECTIONS = 3
_STANDING = HeadRates(0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StationLook:
    """One station's pixel (2,) with its angles in rad; px² of the noise of one frame and of what lasts, (2, 2) each.

    The angles are the stamp's; the head's ``rates`` are for the rows of a rolling shutter, None if unknown.
    """

    station: str
    t_s: float
    pixel: FloatArray
    pan_rad: float
    tilt_rad: float
    noise_px2: FloatArray
    lasting_px2: FloatArray
    rates: HeadRates | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PairRows:
    """The pixels of one pair, linearised at the estimate, two rows for each of N stations.

    Attributes
    ----------
    weight : (2N, 2N) W, 1/px².
    by_point : (2N, 3) H, px per m, runway frame.
    by_fault : (2N, F, 3) E_f, px by the parameters of a fault in its sizes.
    by_calibration : (2N, m) C, px by calibration errors of unit variance.
    residual : (2N,) y, px.
    """

    weight: FloatArray
    by_point: FloatArray
    by_fault: FloatArray
    by_calibration: FloatArray
    residual: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PairTerms:
    """One pair of pictures as the tests take it, for F faults and m calibration errors of unit variance.

    Attributes
    ----------
    fix : (3, F, 3) m along, right and up by the parameters of a fault, in its sizes.
    information : (F, 3, 3) A_f of the parameters, in 1/size².
    residual : (F, 3) E_fᵀ M y; ``from_pixels`` (F, 3, 2N) is E_fᵀ M.
    coupling : (F, 3, m) E_fᵀ M C: what the calibration's errors C put into the residual.
    floor : (3, m) m along, right and up by the calibration's errors.
    """

    fix: FloatArray
    information: FloatArray
    residual: FloatArray
    coupling: FloatArray
    floor: FloatArray
    from_pixels: FloatArray


class FaultGeometry:
    """Faults and calibration errors of one rig as Jacobians.

    Parameters
    ----------
    rig : stations, and the covariance of their calibration and clocks.
    runway : whose axes results are along.
    table : sizes of the faults.
    span_m : the aircraft's wing span.
    constant_px : one sigma of a constant error of each station's pixel that is neither of the rig nor stated with the
        detection.
    """

    def __init__(
        self, rig: Rig, runway: LandingRunway, table: FaultTable, *, span_m: float, constant_px: float
    ) -> None:
        self.hypotheses: tuple[FaultHypothesis, ...] = table.hypotheses(rig.names)
        self._axes = runway.axes()
        self._table, self._span_m, self._constant_px = table, span_m, constant_px
        self._geometries: Mapping[str, StationGeometry] = {s.name: s.geometry() for s in rig.stations}
        self._fixed = {s.name: s.fixed for s in rig.stations}
        self._readout_s = {s.name: s.readout_s for s in rig.stations}
        self._angle_sigma_rad = {s.name: 0.0 if s.fixed else s.angle_sigma_rad for s in rig.stations}
        prior = rig_prior(rig)
        self._columns = {name: _columns(name, prior) for name in rig.names}
        self._root = _root(prior.covariance)
        self._names = rig.names

    def rows(
        self, t_s: float, position_m: FloatArray, velocity_m_s: FloatArray, looks: Sequence[StationLook]
    ) -> PairRows | None:
        """Return the linearised looks at a target at (3,) at time ``t_s``, moving at (3,), runway frame.

        None where fewer than two stations have it in front of them.
        """
        rows = [row for look in looks if (row := self._row(t_s, position_m, velocity_m_s, look)) is not None]
        if len(rows) < 2:
            return None
        return PairRows(
            weight=_block([r.weight for r in rows]),
            by_point=np.vstack([r.by_point for r in rows]),
            by_fault=np.vstack([r.by_fault for r in rows]).reshape(-1, len(self.hypotheses), DIRECTIONS),
            by_calibration=np.hstack([np.vstack([r.by_calibration for r in rows]), self._lasting(rows)]),
            residual=np.concatenate([r.residual for r in rows]),
        )

    def terms(
        self, t_s: float, position_m: FloatArray, velocity_m_s: FloatArray, looks: Sequence[StationLook]
    ) -> PairTerms | None:
        """Return what `rows` means for position and residuals; None where their rays are parallel, too."""
        rows = self.rows(t_s, position_m, velocity_m_s, looks)
        if rows is None:
            return None
        weight, H, C = rows.weight, rows.by_point, rows.by_calibration
        normal = H.T @ weight @ H
        values = np.linalg.eigvalsh(normal)
        if not values[0] > 1e-12 * values[-1]:
            return None
        fix = np.linalg.solve(normal, H.T @ weight)
        M = weight - weight @ H @ fix
        along = self._axes @ fix
        from_pixels = np.einsum("ifd,ij->fdj", rows.by_fault, M)
        return PairTerms(
            fix=np.einsum("ai,ifd->afd", along, rows.by_fault),
            information=np.einsum("fdi,ife->fde", from_pixels, rows.by_fault),
            residual=from_pixels @ rows.residual,
            coupling=from_pixels @ C,
            floor=along @ C,
            from_pixels=from_pixels,
        )

    def _row(
        self, t_s: float, position_m: FloatArray, velocity_m_s: FloatArray, look: StationLook
    ) -> "_StationRow | None":
        """Return a station's rows; None where the target is not in front of it."""
        geometry = self._geometries[look.station]
        rates, sigma_rad = look.rates or _STANDING, self._angle_sigma_rad[look.station]
        delay_s = row_delay_s(float(look.pixel[1]), geometry.image_size_px[1], self._readout_s[look.station])
        if look.rates is None and not self._fixed[look.station]:
            # a head that follows the target shows it in the same pixel whenever its row is exposed
            delay_s = 0.0
        point = position_m + (look.t_s + delay_s - t_s) * velocity_m_s
        pan_rad, tilt_rad = look.pan_rad + delay_s * rates.pan_rad_s, look.tilt_rad + delay_s * rates.tilt_rad_s
        seen = project_with_calibration(geometry, point, pan_rad, tilt_rad)
        if seen is None:
            return None
        by_point, by_angle = seen.jacobian[:, :3], seen.jacobian[:, 3:]
        # readings' noise is in the rates as in the angles
        variances = np.array(rates.angle_variances_rad2(sigma_rad, delay_s))
        noise = look.noise_px2 + by_angle * variances @ by_angle.T
        moved = by_point @ velocity_m_s
        size_px = self._table.detection_spans * self._span_m * geometry.lens.focal_px / seen.depth_m
        effects = {
            StationFault.DETECTION: np.diag(size_px),
            StationFault.MOUNT: by_angle * self._table.mount_rad,
            StationFault.CLOCK: moved[:, None] * self._table.clock_s,
            StationFault.TARGET_POINT: by_point
            @ (self._axes.T * (self._span_m * np.array(self._table.target_point_spans))),
        }
        by_fault = np.zeros((2, len(self.hypotheses), DIRECTIONS))
        for k, hypothesis in enumerate(self.hypotheses):
            if hypothesis.station in ("", look.station):
                effect = effects[hypothesis.fault]
                by_fault[:, k, : effect.shape[1]] = effect
        own = self._columns[look.station]
        sensitivity = np.zeros((2, len(self._root)))
        sensitivity[:, own.calibration] = seen.calibration_jacobian[:, own.parameters]
        # a head that follows the target shows it in the same pixel at whatever time the picture was taken: there the
        # readings' clock counts, at a fixed camera the pictures'
        clocks = own.camera_clock if self._fixed[look.station] else own.ptu_clock
        sensitivity[:, clocks] = moved[:, None]
        return _StationRow(
            station=look.station,
            weight=np.asarray(np.linalg.inv(noise), dtype=np.float64),
            by_point=by_point,
            residual=look.pixel - seen.pixel,
            by_fault=by_fault.reshape(2, -1),
            by_calibration=sensitivity @ self._root,
            lasting=_root(look.lasting_px2 + self._constant_px**2 * np.eye(2)),
        )

    def _lasting(self, rows: "Sequence[_StationRow]") -> FloatArray:
        """Return the columns (2k, 2N) of the stations' own constant errors, unit variance."""
        columns = np.zeros((2 * len(rows), 2 * len(self._names)))
        for k, row in enumerate(rows):
            place = 2 * self._names.index(row.station)
            columns[2 * k : 2 * k + 2, place : place + 2] = row.lasting
        return columns


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _StationRow:
    """Two rows, u and v, of one station, as the module's text names them."""

    station: str
    weight: FloatArray
    by_point: FloatArray
    residual: FloatArray
    by_fault: FloatArray
    by_calibration: FloatArray
    lasting: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class _ErrorColumns:
    """Places of a station's errors in the rig's covariance, and the calibration parameters of the first of them."""

    calibration: list[int]
    parameters: list[int]
    camera_clock: list[int]
    ptu_clock: list[int]


def _columns(station: str, prior: ParameterPrior) -> _ErrorColumns:
    own = {k: n.partition(".")[2] for k, n in enumerate(prior.names) if n.partition(".")[0] == station}
    calibration = [k for k, parameter in own.items() if parameter in CALIBRATION_PARAMETERS]
    return _ErrorColumns(
        calibration=calibration,
        parameters=parameter_indices([own[k] for k in calibration]),
        camera_clock=[k for k, parameter in own.items() if parameter == "camera_clock.offset"],
        ptu_clock=[k for k, parameter in own.items() if parameter == "ptu_clock.offset"],
    )


def _root(covariance: FloatArray) -> FloatArray:
    """Return a matrix L with L Lᵀ = covariance, which may be singular; small negative variances of rounding are 0."""
    if not len(covariance):
        return covariance
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return np.asarray(scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))


def _block(parts: Sequence[FloatArray]) -> FloatArray:
    """Return a block-diagonal matrix of (2, 2) parts."""
    whole = np.zeros((2 * len(parts), 2 * len(parts)))
    for k, part in enumerate(parts):
        whole[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = part
    return whole
