"""Protection levels of a position along, right of and above the direction of landing.

Multiple-hypothesis solution separation (Blanch et al. 2012 and 2015; Joerger, Chan and Pervan 2014) with the faults of
`fault_table`, one at a time. Under fault f with parameters b, in units of its size, the filter's position is off by
e₀ + S_f b. The window's residuals (`fault_geometry`: sums A of information, g of residuals, G of what the calibration
puts into them) give with Σ = A + G Gᵀ the information I = A Σ⁻¹ A on b, and with b's prior of unit variance

    b̃ = (1 + I)⁻¹ A Σ⁻¹ g,    Δ_f = S_f b̃,    B = (1 + I)⁻¹.

Δ_f is the separation of the solution from that which allows for the fault. Where three or more stations see the
target, I is large in all directions of a station's fault, and Δ_f is the separation from the solution without that
station. In a direction without information, b̃ is zero and B one: the fault's size itself goes into the position. So
the level

    PL = max over f of T_f + K_f (σ₀² + S_f B S_fᵀ + 2 |x|)^½,    T_f = K_a (S_f B I B S_fᵀ)^½

holds what the residuals see by the threshold T_f, above which the test alarms, and what they do not see by the stated
size; x is what the calibration puts into e₀ and b̃ together, and the fault-free term is K₀ σ₀. K₀, K_f, K_a come from
the risk (`FaultTable.allocation`); σ₀ from the filter's covariance, which has the calibration's floor in it.

With two stations there is one residual a pair, the distance of the two rays: it sees that one station looks higher than
the other. It does not see a wrong range, a common turn of both, or a wrong point that both agree on; these enter with
their sizes.

The window is as long as the time to alert. From then on a fault that began at some time fills it; before that the error
has lasted less than the time to alert. The filter averages for longer and follows a fault with a delay, then for a
moment by more than one fix would: `following`.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, fields

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.errors import ConfigError
from groundstation.integrity.fault_geometry import DIRECTIONS, FaultGeometry, PairTerms, StationLook
from groundstation.landing_site.fault_table import FaultTable
from groundstation.landing_site.runway import LandingRunway
from groundstation.messages import Kinematics
from groundstation.rig.rig import Rig

FAULT_FREE = "no fault"
# a direction with less information than this in one size of the fault is not seen: its test would compare noise
_LEAST_INFORMATION = 1e-2
# separations below this are rounding
_LEAST_SIGMA_M = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class ProtectionConfig:
    """Tuning of the protection levels.

    Attributes
    ----------
    faults : priors, sizes and risk.
    window_s : time over which residuals are summed; the time to alert.
    inflation : factor of the filter's sigma: ANEES is 0.48 and 0.81 on the two recordings that no part of the detector
        was made with (docs/results.md); earlier detectors had up to 1.45, whose root the factor is.
    following : by how much more than one fix the filter follows a fault at most: measured in
        benchmarks/integrity_study.py.
    constant_px : one sigma of a constant error of each station's pixel that neither rig nor detection state.
    """

    faults: FaultTable = field(default_factory=FaultTable)
    window_s: float = 0.5
    inflation: float = 1.2
    following: float = 1.3
    constant_px: float = 0.5

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(value, float) and not 0.0 <= value <= 100.0:
                raise ConfigError(f"protection levels: {item.name}", got=f"{value:g}", wanted="a number from 0 to 100")
        if not self.window_s > 0.0 or self.inflation < 1.0 or self.following < 1.0:
            got = f"window_s {self.window_s:g}, inflation {self.inflation:g}, following {self.following:g}"
            raise ConfigError("protection levels", got=got, wanted="a window above 0 s and factors of 1 or more")


@dataclass(frozen=True, slots=True, kw_only=True)
class ProtectionLevels:
    """Bounds of the position error at ``t_s``, m, and the result of the residual test.

    Attributes
    ----------
    along_m, lateral_m, vertical_m : of the error along, right of and above the direction of landing.
    worst : for each of them in words the hypothesis that it comes from.
    separation : the largest separation over its threshold; above 1 the residuals show a fault.
    suspected : in words the fault with the largest separation.
    pairs : number of pairs in the window.
    """

    t_s: float
    along_m: float
    lateral_m: float
    vertical_m: float
    worst: tuple[str, str, str]
    separation: float
    suspected: str
    pairs: int

    @property
    def fault_detected(self) -> bool:
        """Whether the residuals show a fault."""
        return self.separation > 1.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WindowSums:
    """Sums over a window of pairs: arrays of `PairTerms`, with ``fix`` and ``floor`` of the last pair."""

    fix: FloatArray
    floor: FloatArray
    information: FloatArray
    residual: FloatArray
    coupling: FloatArray
    pairs: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SeparationModel:
    """What a window tells of F faults, by axes along, right, up.

    Attributes
    ----------
    from_residual : (F, 3, 3) separations in m by the sums of residuals (F, 3).
    separation_sigma_m : (F, 3) of a separation without a fault.
    fault_variance_m2 : (F, 3) of the position by what remains unknown of a fault, with what it has in common with the
        fault-free error.
    """

    from_residual: FloatArray
    separation_sigma_m: FloatArray
    fault_variance_m2: FloatArray


def separation_model(sums: WindowSums, following: float) -> SeparationModel:
    """Return the linear model of the module's text for all faults at once."""
    values, vectors = np.linalg.eigh(0.5 * (sums.information + np.swapaxes(sums.information, 1, 2)))
    seen = values > _LEAST_INFORMATION
    known = np.where(seen, values, 0.0)
    turned = np.swapaxes(vectors, 1, 2) @ sums.coupling * seen[..., None]
    unit = np.eye(DIRECTIONS)
    spread = turned @ np.swapaxes(turned, 1, 2) + np.where(seen, known, 1.0)[..., None] * unit
    gain = known[..., None] * np.linalg.inv(spread)
    information = gain * known[:, None, :]
    left = np.linalg.inv(unit + information)
    estimate = left @ gain
    S = following * np.swapaxes(sums.fix, 0, 1) @ vectors
    from_residual = S @ estimate @ np.swapaxes(vectors, 1, 2)
    separation = S @ left @ information @ left
    variance = np.einsum("fai,fai->fa", S @ left, S)
    common = np.einsum("fam,am->fa", S @ estimate @ turned, sums.floor)
    return SeparationModel(
        from_residual=from_residual,
        separation_sigma_m=np.sqrt(np.maximum(np.einsum("fai,fai->fa", separation, S), 0.0)),
        fault_variance_m2=variance + 2.0 * np.abs(common),
    )


class ProtectionLevelMonitor:
    """Protection levels of an estimate, pair by pair.

    Parameters
    ----------
    rig : stations and what is known of their calibration.
    runway : in use; its axes are those of the levels.
    span_m : the aircraft's wing span.
    """

    def __init__(
        self,
        rig: Rig,
        runway: LandingRunway,
        config: ProtectionConfig | None = None,
        *,
        span_m: float = 2.3,
    ) -> None:
        self.config = ProtectionConfig() if config is None else config
        table = self.config.faults
        self.allocation = table.allocation(rig.names)
        self._axes = runway.axes()
        self._geometry = FaultGeometry(rig, runway, table, span_m=span_m, constant_px=self.config.constant_px)
        self._pairs: deque[tuple[float, PairTerms]] = deque()

    def forget(self) -> None:
        """Clear the window, for another target."""
        self._pairs.clear()

    def add_pair(self, t_s: float, kinematics: Kinematics, looks: Sequence[StationLook]) -> None:
        """Add the looks of one pair at the target that is estimated at ``t_s``; fewer than two add nothing."""
        terms = self._geometry.terms(t_s, kinematics.position_runway_m, kinematics.velocity_runway_m_s, looks)
        while self._pairs and not t_s - self.config.window_s < self._pairs[0][0] <= t_s:
            self._pairs.popleft()
        if terms is not None:
            self._pairs.append((t_s, terms))

    def window(self) -> WindowSums | None:
        """Return the sums of the window; None without a pair."""
        terms = [pair for _, pair in self._pairs]
        if not terms:
            return None
        return WindowSums(
            fix=terms[-1].fix,
            floor=terms[-1].floor,
            information=np.sum([p.information for p in terms], axis=0),
            residual=np.sum([p.residual for p in terms], axis=0),
            coupling=np.sum([p.coupling for p in terms], axis=0),
            pairs=len(terms),
        )

    def levels(self, t_s: float, kinematics: Kinematics) -> ProtectionLevels | None:
        """Return the levels of an estimate at ``t_s``; None without a pair in the window or a finite covariance."""
        sums = self.window()
        if sums is None or not np.isfinite(kinematics.covariance).all():
            return None
        model = separation_model(sums, self.config.following)
        bounds = self.bounds_m(self._axes @ kinematics.covariance[:3, :3] @ self._axes.T, model)
        worst = [int(k) for k in bounds.argmax(axis=0)]
        names = (FAULT_FREE, *(h.words() for h in self.allocation.hypotheses))
        ratios = self.separations(model, sums.residual)
        suspected = int(ratios.argmax())
        along, lateral, vertical = (float(v) for v in bounds.max(axis=0))
        return ProtectionLevels(
            t_s=t_s,
            along_m=along,
            lateral_m=lateral,
            vertical_m=vertical,
            worst=(names[worst[0]], names[worst[1]], names[worst[2]]),
            separation=float(ratios[suspected]),
            suspected=names[1 + suspected],
            pairs=sums.pairs,
        )

    def bounds_m(self, covariance_m2: FloatArray, model: SeparationModel) -> FloatArray:
        """Return (1 + F, 3) bounds under no fault and each one; ``covariance_m2`` (3, 3) is along, right, up."""
        allocation = self.allocation
        own = self.config.inflation**2 * np.maximum(np.diag(covariance_m2), 0.0)
        sigma = np.sqrt(own + model.fault_variance_m2)
        faulty = allocation.alarm * model.separation_sigma_m + allocation.faulty[:, None] * sigma
        faulty = np.where(allocation.monitored[:, None], faulty, 0.0)
        return np.vstack([allocation.fault_free * np.sqrt(own), faulty])

    def separations(self, model: SeparationModel, residual: FloatArray) -> FloatArray:
        """Return (F,) the largest separation of each fault over its threshold; ``residual`` (F, 3) of the window."""
        found = np.abs(np.einsum("fad,fd->fa", model.from_residual, residual))
        limit = self.allocation.alarm * model.separation_sigma_m
        return np.asarray(np.where(limit > _LEAST_SIGMA_M, found / np.maximum(limit, _LEAST_SIGMA_M), 0.0).max(axis=1))
