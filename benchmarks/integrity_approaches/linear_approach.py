"""Approaches in numbers: errors, residuals and advice along one planned path, linear in noise and faults.

Geometry, protection levels, separations and the nominal advice are those of `groundstation.integrity`, taken once along
the path; a filter of position and velocity with the tuning's steady motion follows with the gains that it has there.
What is drawn: pixel and angle noise, motion, calibration errors, and a fault with its size and its beginning. A hundred
thousand approaches take seconds. `whole_filter` compares it with the pipeline.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from groundstation.arrays import FloatArray, MaskArray
from groundstation.estimation.state_model import STEADY_PSD_M2_S3
from groundstation.evaluation.bounds import motion_matrices
from groundstation.geometry.aim import aim_at
from groundstation.integrity.approach_advice import AdviceConfig, AdviceLevel, AdviceRules, Situation
from groundstation.integrity.fault_geometry import FaultGeometry, PairRows, StationLook
from groundstation.integrity.protection_levels import ProtectionLevelMonitor, ProtectionLevels, separation_model
from groundstation.messages import Kinematics, TrackStatus
from groundstation.simulation.approach import GlideApproach
from integrity_approaches.fault_list import DRIFT_S, SITE, SPAN_M, StudiedSite

PIXEL_SIGMA_PX = 0.5
PATH = GlideApproach(start_y_m=400.0, end_y_m=65.0)
STEP_S = 0.1
# of the filter when the approach begins
_START_POSITION_M, _START_VELOCITY_M_S = 3.0, 3.0
# a third of the faults are there when it begins
_BEFORE_SHARE = 1.0 / 3.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DrawnFaults:
    """Faults of n approaches.

    Attributes
    ----------
    parameters : (n, F, 3) in sizes, as `FaultGeometry` orders them; zero where there is none.
    begin_s : (n,) when they begin.
    drifting : whether they grow to their size within `DRIFT_S` and beyond, instead of stepping there.
    """

    parameters: FloatArray
    begin_s: FloatArray
    drifting: bool = False

    def share_at(self, t_s: float) -> FloatArray:
        """Return (n,) by which factor of its parameters a fault is there at a time."""
        age = t_s - self.begin_s
        return np.where(age < 0.0, 0.0, age / DRIFT_S if self.drifting else 1.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Outcomes:
    """What became of n approaches over k times; axes along, right, up.

    Attributes
    ----------
    misleading : (n,) largest share of the alert limits that an error exceeded, while GO, for the time to alert.
    exceeding : (n,) largest share of the protection levels that an error exceeded for that long without an alarm so
        far, whatever the advice was.
    alarmed : (n,) whether the residual test alarmed.
    alarm_s : (n,) when it did first, infinite never.
    go : (n, k) whether the advice was GO.
    error_m : (n, k, 3).
    separations : (n, k) the largest separation over its threshold, at each time.
    """

    misleading: FloatArray
    exceeding: FloatArray
    alarmed: MaskArray
    alarm_s: FloatArray
    go: MaskArray
    error_m: FloatArray
    separations: FloatArray

    @property
    def separation(self) -> FloatArray:
        """The largest of an approach (n,)."""
        return np.asarray(self.separations.max(axis=1))


class LinearApproach:
    """One site's approach along the planned path."""

    def __init__(self, site: StudiedSite) -> None:
        self.site = site
        table, rig = site.config.faults, site.rig
        self.t_s = np.arange(PATH.span_s[0], PATH.span_s[1] + 1e-9, STEP_S)
        self.position_m, self.velocity_m_s = PATH.position(self.t_s), PATH.velocity(self.t_s)
        self.geometry = FaultGeometry(rig, SITE.runway, table, span_m=SPAN_M, constant_px=site.config.constant_px)
        self.hypotheses = self.geometry.hypotheses
        self._axes = SITE.runway.axes()
        self.rows = [self._rows(k) for k in range(len(self.t_s))]
        self._filter()
        self._levels()
        self._advice()

    # ------------------------------------------------------------------------- once along the path
    def looks(self, k: int) -> tuple[StationLook, ...]:
        """Return the looks at the aircraft at epoch k without noise."""
        looks = []
        for station in self.site.rig.stations:
            aimed = aim_at(station.geometry(), self.position_m[k])
            if aimed is None:
                raise ValueError(f"station {station.name} cannot be turned to epoch {k}")
            looks.append(
                StationLook(
                    station=station.name,
                    t_s=float(self.t_s[k]),
                    pixel=station.lens.principal_point_px,
                    pan_rad=aimed.pan_rad,
                    tilt_rad=aimed.tilt_rad,
                    noise_px2=PIXEL_SIGMA_PX**2 * np.eye(2),
                    lasting_px2=np.zeros((2, 2)),
                )
            )
        return tuple(looks)

    def _rows(self, k: int) -> PairRows:
        ahead = [look for look in self.looks(k) if self._sees(look.station, k)]
        rows = self.geometry.rows(float(self.t_s[k]), self.position_m[k], self.velocity_m_s[k], ahead)
        if rows is None:
            raise ValueError(f"fewer than two stations see epoch {k}")
        return rows

    def _sees(self, station: str, k: int) -> bool:
        """Return whether a station has the aircraft at least 10 m in front of it: the third is flown past."""
        return bool(self.position_m[k, 1] - self.site.rig[station].ptu_position_m[1] > 10.0)

    def _filter(self) -> None:
        """Gains and covariances of the filter along the path, the calibration's floor in them."""
        psd = np.array(STEADY_PSD_M2_S3)
        P = np.diag([_START_POSITION_M**2] * 3 + [_START_VELOCITY_M_S**2] * 3)
        floor = np.zeros((6, self.rows[0].by_calibration.shape[1]))
        self.gains: list[FloatArray] = []
        self.covariances: list[FloatArray] = []
        self.F, self.Q = motion_matrices(STEP_S, psd)
        self.start = P
        for k, rows in enumerate(self.rows):
            H = np.hstack([rows.by_point, np.zeros((len(rows.residual), 3))])
            F = self.F if k else np.eye(6)
            P = F @ P @ F.T + (self.Q if k else 0.0)
            K = P @ H.T @ np.linalg.inv(H @ P @ H.T + np.linalg.inv(rows.weight))
            P = (np.eye(6) - K @ H) @ P
            P = 0.5 * (P + P.T)
            floor = (np.eye(6) - K @ H) @ F @ floor + K @ rows.by_calibration
            self.gains.append(K)
            self.covariances.append(P + floor @ floor.T)

    def _levels(self) -> None:
        """Levels, and the linear maps from residual sums to separations over their thresholds."""
        monitor = ProtectionLevelMonitor(self.site.rig, SITE.runway, self.site.config, span_m=SPAN_M)
        self.levels: list[ProtectionLevels] = []
        self.tests: list[FloatArray] = []
        self.from_pixels: list[FloatArray] = []
        self.fixes: list[FloatArray] = []
        for k, t_s in enumerate(self.t_s.tolist()):
            known = Kinematics(
                position_runway_m=self.position_m[k],
                velocity_runway_m_s=self.velocity_m_s[k],
                covariance=self.covariances[k],
            )
            looks = [look for look in self.looks(k) if self._sees(look.station, k)]
            monitor.add_pair(t_s, known, looks)
            levels, sums = monitor.levels(t_s, known), monitor.window()
            terms = self.geometry.terms(t_s, known.position_runway_m, known.velocity_runway_m_s, looks)
            if levels is None or sums is None or terms is None:
                raise ValueError(f"no level at epoch {k}")
            self.levels.append(levels)
            model = separation_model(sums, self.site.config.following)
            limit = monitor.allocation.alarm * model.separation_sigma_m
            over = np.where(limit > 1e-9, 1.0 / np.maximum(limit, 1e-9), 0.0)
            # one row for each separation, all residual sums (3 F) as columns
            tests = np.zeros((*over.shape, 3 * len(over)))
            for f, test in enumerate(model.from_residual * over[..., None]):
                tests[f, :, 3 * f : 3 * f + 3] = test
            rows = tests.reshape(-1, 3 * len(over))
            self.tests.append(rows[rows.any(axis=1)])
            self.from_pixels.append(terms.from_pixels)
            self.fixes.append(terms.fix)
        self.level_m = np.array([[v.along_m, v.lateral_m, v.vertical_m] for v in self.levels])

    def _advice(self) -> None:
        """The advice without alarms, by the rules themselves, and the limits at the true height."""
        limits, self.advice_config = SITE.alert_limits, AdviceConfig()
        rules = AdviceRules(limits, self.advice_config)
        go, low = [], []
        for k, t_s in enumerate(self.t_s.tolist()):
            situation = Situation(
                now_s=t_s,
                estimate_s=t_s,
                pair_s=t_s,
                status=TrackStatus.TRACKING,
                levels=self.levels[k],
                height_m=float(self.position_m[k, 2]),
                sink_m_s=-float(self.velocity_m_s[k, 2]),
                fault_s=-np.inf,
                fault="",
            )
            go.append(rules.advise(situation).level is AdviceLevel.GO)
            lowest = situation.lowest_m
            low.append(lowest is not None and lowest <= limits.low_height_m)
        self.nominal_go, self.low = np.array(go), np.array(low)
        self.limit_m = np.array(
            [[limits.along_m, limits.lateral_m, limits.vertical_at(float(z))] for z in self.position_m[:, 2]]
        )

    # -------------------------------------------------------------------------------- many approaches
    def begins(self, rng: np.random.Generator, n: int) -> FloatArray:
        """Draw when faults begin (n,): a third before the approach, the others uniformly within it."""
        first, last = float(self.t_s[0]), float(self.t_s[-1])
        return np.where(rng.random(n) < _BEFORE_SHARE, first - 10.0, rng.uniform(first, last, n))

    def fly(self, rng: np.random.Generator, faults: DrawnFaults, *, noise: float = 1.0) -> Outcomes:
        """Fly n approaches with these faults; ``noise`` 0 leaves out everything random but the faults."""
        n, epochs = len(faults.begin_s), len(self.t_s)
        parameters = faults.parameters.reshape(n, -1)
        c = noise * rng.normal(size=(n, self.rows[0].by_calibration.shape[1]))
        e = noise * rng.normal(size=(n, 6)) @ np.linalg.cholesky(self.start).T
        step = np.linalg.cholesky(self.Q)
        error, separations = np.empty((n, epochs, 3)), np.empty((n, epochs))
        window: list[FloatArray] = []
        for k, rows in enumerate(self.rows):
            if k:
                e = e @ self.F.T + noise * rng.normal(size=(n, 6)) @ step.T
            pixels = noise * rng.normal(size=(n, len(rows.residual))) @ np.linalg.cholesky(np.linalg.inv(rows.weight)).T
            pixels += c @ rows.by_calibration.T
            by_fault = rows.by_fault.reshape(len(rows.residual), -1)
            pixels += (parameters * faults.share_at(float(self.t_s[k]))[:, None]) @ by_fault.T
            window = [*window[-(round(self.site.config.window_s / STEP_S) - 1) :], pixels @ _flat(self.from_pixels[k])]
            e = e + (pixels - e[:, :3] @ rows.by_point.T) @ self.gains[k].T
            error[:, k] = e[:, :3] @ self._axes.T
            separations[:, k] = self._separation(np.sum(window, axis=0), k)
        return self._judged(error, separations)

    def _separation(self, residual: FloatArray, k: int) -> FloatArray:
        """Return (n,) the largest separation over its threshold, from residual sums (n, 3 F)."""
        return np.asarray(np.abs(self.tests[k] @ residual.T).max(axis=0))

    def _judged(self, error: FloatArray, separations: FloatArray) -> Outcomes:
        """Apply alarms, latch and alert limits."""
        n, epochs = separations.shape
        hold_s = self.advice_config.fault_hold_s + self.advice_config.recover_s
        last_s, latched = np.full(n, -np.inf), np.zeros(n, dtype=bool)
        go = np.zeros((n, epochs), dtype=bool)
        for k in range(epochs):
            last_s[separations[:, k] > 1.0] = self.t_s[k]
            off = self.t_s[k] - last_s <= hold_s
            latched |= off & self.low[k]
            go[:, k] = self.nominal_go[k] & ~off & ~latched
        alarms = separations > 1.0
        quiet = ~np.logical_or.accumulate(alarms, axis=1)
        first = np.where(alarms.any(axis=1), self.t_s[alarms.argmax(axis=1)], np.inf)
        return Outcomes(
            misleading=lasting_share(np.where(go, largest_share(error, self.limit_m), 0.0)),
            exceeding=lasting_share(np.where(quiet, largest_share(error, self.level_m), 0.0)),
            alarmed=np.asarray(alarms.any(axis=1)),
            alarm_s=first,
            go=go,
            error_m=error,
            separations=separations,
        )

    def fault_free_risk(self) -> float:
        """Return a bound of the probability that a fault-free error exceeds a limit while GO: a sum over all times."""
        axes = self._axes
        variance = np.array([np.diag(axes @ P[:3, :3] @ axes.T) for P in self.covariances])
        chance = 2.0 * ndtr(-self.limit_m / np.sqrt(variance))
        return float(chance[self.nominal_go].sum())


def largest_share(error_m: FloatArray, bound_m: FloatArray) -> FloatArray:
    """Return (n, k) the largest of three errors (n, k, 3) over their bounds (k, 3)."""
    shares = np.abs(error_m) / bound_m
    return np.asarray(np.maximum(np.maximum(shares[..., 0], shares[..., 1]), shares[..., 2]))


def lasting_share(shares: FloatArray) -> FloatArray:
    """Return (n,) what shares (n, k) exceed at all times of some interval as long as the time to alert."""
    length, epochs = round(SITE.alert_limits.time_to_alert_s / STEP_S) + 1, shares.shape[1]
    lasting = shares[:, : epochs - length + 1].copy()
    for later in range(1, length):
        np.minimum(lasting, shares[:, later : epochs - length + 1 + later], out=lasting)
    return np.asarray(lasting.max(axis=1))


def _flat(from_pixels: FloatArray) -> FloatArray:
    """Return E_fᵀ M (F, 3, 2N) as (2N, 3 F)."""
    return from_pixels.reshape(-1, from_pixels.shape[2]).T


def no_fault(n: int, hypotheses: Sequence[object]) -> DrawnFaults:
    """Return n approaches without a fault."""
    return DrawnFaults(parameters=np.zeros((n, len(hypotheses), 3)), begin_s=np.full(n, np.inf))
