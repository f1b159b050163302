"""The inertial filter over many approaches, with 20 s without runway; the paper's figures 4 to 7 of one of them."""

from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
from scipy.stats import chi2

from groundstation.geometry.rotation import matrix_from_wxyz
from groundstation.onboard.pose.coplanarity_solver import solve_coplanarity
from groundstation.onboard.pose.inertial_filter import ATTITUDE, POSITION, VELOCITY, UpdateOutcome, rotation_vector
from groundstation.onboard.pose.runway_navigator import RunwayNavigator
from groundstation.onboard.pose.simulated_approach import ApproachSetup, SimulatedApproach, default_setup, fly

FROM_S, EVERY, LAGS = 5.0, 10, 10
PHASES = {
    "seen": (5.0, 25.0),
    "lost, first half": (25.0, 35.0),
    "lost, second half": (35.0, 45.0),
    "again": (45.5, 54.0),
}
POSE = np.r_[POSITION, ATTITUDE]


@dataclass(slots=True, kw_only=True)
class Run:
    """Errors and sigmas (n, 15), NEES of pose and of all (n,), at times (n,); innovations (m, 6), whitened too."""

    t_s: np.ndarray
    error: np.ndarray
    sigma: np.ndarray
    nees_pose: np.ndarray
    nees: np.ndarray
    innovation_t_s: np.ndarray
    innovation: np.ndarray
    innovation_sigma: np.ndarray
    white: np.ndarray
    outcomes: dict[str, int]
    estimate: np.ndarray


def run(setup: ApproachSetup, approach: SimulatedApproach) -> Run:
    navigator = RunwayNavigator(setup.config, setup.mount)
    rows, innovations, outcomes = [], [], {}
    for k, sample in enumerate(approach.samples):
        navigator.process_imu(sample)
        if k in approach.seen:
            innovation = navigator.update(sample.t_s, approach.seen[k]).innovation
            word = "no fit" if innovation is None else innovation.outcome.value
            outcomes[word] = outcomes.get(word, 0) + 1
            if innovation is not None and innovation.outcome is UpdateOutcome.USED:
                white = np.linalg.solve(np.linalg.cholesky(innovation.covariance), innovation.value)
                innovations.append((sample.t_s, innovation.value, np.sqrt(np.diag(innovation.covariance)), white))
        if k % EVERY == 0 and sample.t_s >= FROM_S:
            now = navigator.navigation
            turn = rotation_vector(approach.runway_from_body[k] @ matrix_from_wxyz(now.runway_from_body_wxyz).T)
            e = np.concatenate(
                [
                    approach.position_m[k] - now.position_m,
                    approach.velocity_m_s[k] - now.velocity_m_s,
                    turn,
                    approach.force_bias[k] - now.force_bias_m_s2,
                    approach.rate_bias[k] - now.rate_bias_rad_s,
                ]
            )
            P6 = now.P[np.ix_(POSE, POSE)]
            rows.append(
                (sample.t_s, e, np.sqrt(np.diag(now.P)), e[POSE] @ np.linalg.solve(P6, e[POSE]),
                 e @ np.linalg.solve(now.P, e), now.position_m)
            )  # fmt: skip
    t, error, sigma, nees_pose, nees, estimate = (np.array(column) for column in zip(*rows, strict=True))
    it, value, value_sigma, white = (np.array(column) for column in zip(*innovations, strict=True))
    return Run(
        t_s=t, error=error, sigma=sigma, nees_pose=nees_pose, nees=nees, innovation_t_s=it, innovation=value,
        innovation_sigma=value_sigma, white=white, outcomes=outcomes, estimate=estimate,
    )  # fmt: skip


def flight_study(runs: int, figures: Path | None, first: int) -> dict[str, object]:
    """Shares inside ±2σ, NEES by phase with the band of as many flights, whiteness, and drift without the runway."""
    setup = default_setup(0.5)
    done = []
    for seed in range(runs):
        approach = fly(setup, np.random.default_rng([first, seed]))
        done.append(run(setup, approach))
        if seed == 0 and figures is not None:
            draw(figures, setup, approach, done[0])
    inside = np.array([np.abs(one.error) < 2 * one.sigma for one in done])
    t = done[0].t_s
    out: dict[str, object] = {
        "runs": runs,
        "inside_2_sigma": {
            "position": round(float(inside[..., POSITION].mean()), 4),
            "position_axes": inside[..., POSITION].mean(axis=(0, 1)).round(4).tolist(),
            "attitude": round(float(inside[..., ATTITUDE].mean()), 4),
            "attitude_axes": inside[..., ATTITUDE].mean(axis=(0, 1)).round(4).tolist(),
            "velocity": round(float(inside[..., VELOCITY].mean()), 4),
        },
        "band_95_of_a_mean_over_flights": {
            "pose, 6": (chi2.ppf([0.025, 0.975], 6 * runs) / runs).round(2).tolist(),
            "all, 15": (chi2.ppf([0.025, 0.975], 15 * runs) / runs).round(2).tolist(),
        },
    }
    phases = {}
    for name, (low, high) in PHASES.items():
        used = (t >= low) & (t < high)
        phases[name] = {
            "nees_pose": round(float(np.mean([one.nees_pose[used].mean() for one in done])), 2),
            "nees_all": round(float(np.mean([one.nees[used].mean() for one in done])), 2),
            "position_rmse_m": np.sqrt(
                np.mean([one.error[used][:, POSITION] ** 2 for one in done], axis=(0, 1))
            ).round(2).tolist(),
            "attitude_rmse_deg": np.degrees(
                np.sqrt(np.mean([one.error[used][:, ATTITUDE] ** 2 for one in done], axis=(0, 1)))
            ).round(3).tolist(),
        }  # fmt: skip
    out["phases"] = phases
    last = int(np.flatnonzero(t < 45.0)[-1])
    drift = np.array([one.error[last, POSITION] for one in done])
    first = int(np.flatnonzero(t < 25.0)[-1])
    before = np.array([one.error[first, POSITION] for one in done])
    out["after_20_s_without_runway_m"] = {
        "rms_xyz_before": np.sqrt((before**2).mean(axis=0)).round(2).tolist(),
        "rms_xyz": np.sqrt((drift**2).mean(axis=0)).round(2).tolist(),
        "median_3d": round(float(np.median(np.linalg.norm(drift, axis=1))), 2),
        "p95_3d": round(float(np.quantile(np.linalg.norm(drift, axis=1), 0.95)), 2),
        "sigma_xyz": np.sqrt(np.mean([one.sigma[last, POSITION] ** 2 for one in done], axis=0)).round(2).tolist(),
        "nees_pose": round(float(np.mean([one.nees_pose[last] for one in done])), 2),
        "nees_all": round(float(np.mean([one.nees[last] for one in done])), 2),
    }
    out["innovations"] = whiteness(done)
    words: dict[str, int] = {}
    for one in done:
        for word, count in one.outcomes.items():
            words[word] = words.get(word, 0) + count
    out["outcomes"] = words
    return out


def whiteness(done: list[Run]) -> dict[str, object]:
    """Mean square, autocorrelation by lag over all flights, and how many flights pass a portmanteau test at 95 %."""
    white = [one.white for one in done]
    count = sum(len(w) for w in white)
    lags = [
        np.concatenate([(w[lag:] * w[:-lag]).reshape(-1, 6) for w in white]).mean(axis=0) for lag in range(1, LAGS + 1)
    ]
    passed = 0
    for w in white:
        n = len(w)
        q = sum(
            n * ((w[lag:] * w[:-lag]).sum(axis=0) / (w**2).sum(axis=0)) ** 2 * (n + 2) / (n - lag)
            for lag in range(1, LAGS + 1)
        )
        passed += int(float(np.sum(q)) < chi2.ppf(0.95, 6 * LAGS))
    bound = 1.96 / np.sqrt(count)
    outside = np.mean([np.abs(lag) > bound for lag in lags])
    return {
        "nis_of_6": round(float(np.mean([(w**2).sum(axis=1).mean() for w in white])), 3),
        "lag_1": lags[0].round(4).tolist(),
        "bound_95": round(float(bound), 4),
        "share_of_60_autocorrelations_outside": round(float(outside), 3),
        "flights_that_pass": round(passed / len(white), 3),
    }


def draw(folder: Path, setup: ApproachSetup, approach: SimulatedApproach, one: Run) -> None:
    """Write the paper's figures 4 to 7 for one approach."""
    mpl.use("Agg")
    _draw_path(folder / "onboard-pose-path.png", setup, approach, one)
    _draw_position(folder / "onboard-pose-position.png", setup, approach, one)
    _draw_errors(folder / "onboard-pose-errors.png", setup, one)
    _draw_innovations(folder / "onboard-pose-innovations.png", one)


def _draw_path(path: Path, setup: ApproachSetup, approach: SimulatedApproach, one: Run) -> None:
    """Write the true and the estimated path in space and from above (figure 4)."""
    from matplotlib import pyplot as plt

    lost = setup.lost_s
    figure = plt.figure(figsize=(10, 4.5))
    axes = figure.add_subplot(1, 2, 1, projection="3d")
    for track, style, name in ((approach.position_m, "k-", "true"), (one.estimate, "C1--", "filter")):
        axes.plot(track[:, 0], track[:, 1], track[:, 2], style, lw=1.2, label=name)
    corners = np.vstack([setup.runway.corners_m, setup.runway.corners_m[:1]])
    axes.plot(corners[:, 0], corners[:, 1], corners[:, 2], "C2-", lw=1, label="runway")
    axes.set(xlabel="x / m", ylabel="y / m", zlabel="z / m")
    axes.legend(fontsize=8)
    flat = figure.add_subplot(1, 2, 2)
    flat.plot(approach.position_m[:, 1], approach.position_m[:, 0], "k-", lw=1.2, label="true")
    flat.plot(one.estimate[:, 1], one.estimate[:, 0], "C1--", lw=1.2, label="filter")
    gone = (approach.t_s >= lost[0]) & (approach.t_s < lost[1])
    flat.plot(
        approach.position_m[gone, 1], approach.position_m[gone, 0], "C3-", lw=4, alpha=0.3, label="no runway in view"
    )
    flat.set(xlabel="y / m", ylabel="x / m")
    flat.invert_xaxis()
    flat.legend(fontsize=8)
    _save(figure, path)


def _draw_position(path: Path, setup: ApproachSetup, approach: SimulatedApproach, one: Run) -> None:
    """Write the position, the steps of the paper's cost and the errors in range and height over time (figure 5)."""
    from matplotlib import pyplot as plt

    lost = setup.lost_s
    figure, all_axes = plt.subplots(3, 2, figsize=(10, 6), sharex="col")
    for k, axis in enumerate("xyz"):
        all_axes[k, 0].plot(approach.t_s, approach.position_m[:, k], "k-", lw=1)
        all_axes[k, 0].plot(one.t_s, one.estimate[:, k], "C1--", lw=1)
        all_axes[k, 0].set_ylabel(f"{axis} / m")
        all_axes[k, 0].axvspan(*lost, color="C3", alpha=0.1)
    steps = [(approach.t_s[j], solve_coplanarity(seen).steps) for j, seen in approach.seen.items()]
    all_axes[0, 1].plot(*np.array(steps).T, ".", ms=3)
    all_axes[0, 1].set_ylabel("steps, paper's cost")
    for k, name in ((1, "range"), (2, "height")):
        part = one.error[:, 1 if k == 1 else 2]
        all_axes[k, 1].plot(one.t_s, part, lw=1)
        all_axes[k, 1].set_ylabel(f"{name} error / m")
    for ax in all_axes[2]:
        ax.set_xlabel("t / s")
    _save(figure, path)


def _draw_errors(path: Path, setup: ApproachSetup, one: Run) -> None:
    """Write the errors in velocity and attitude with their 2 sigma bounds over time (figure 6)."""
    from matplotlib import pyplot as plt

    lost = setup.lost_s
    figure, all_axes = plt.subplots(3, 2, figsize=(10, 6), sharex=True)
    for column, (part, unit, scale) in enumerate(
        ((VELOCITY, "v / (m/s)", 1.0), (ATTITUDE, "θ / deg", np.degrees(1.0)))
    ):
        for k in range(3):
            ax = all_axes[k, column]
            ax.plot(one.t_s, scale * one.error[:, part][:, k], lw=1)
            sigma = 2 * scale * one.sigma[:, part][:, k]
            ax.fill_between(one.t_s, -sigma, sigma, color="C0", alpha=0.15)
            ax.axvspan(*lost, color="C3", alpha=0.1)
            ax.set_ylabel(f"{'xyz'[k]}: {unit}")
        all_axes[2, column].set_xlabel("t / s")
    _save(figure, path)


def _draw_innovations(path: Path, one: Run) -> None:
    """Write the innovations with their 2 sigma bounds over time (figure 7)."""
    from matplotlib import pyplot as plt

    figure, all_axes = plt.subplots(3, 2, figsize=(10, 6), sharex=True)
    for column, (unit, scale) in enumerate((("m", 1.0), ("deg", np.degrees(1.0)))):
        for k in range(3):
            ax, part = all_axes[k, column], 3 * column + k
            sigma = 2 * scale * one.innovation_sigma[:, part]
            ax.plot(one.innovation_t_s, scale * one.innovation[:, part], ".", ms=2)
            ax.plot(one.innovation_t_s, sigma, "C3.", ms=1)
            ax.plot(one.innovation_t_s, -sigma, "C3.", ms=1)
            ax.set_ylabel(f"{'position' if column == 0 else 'attitude'} {'xyz'[k]} / {unit}")
        all_axes[2, column].set_xlabel("t / s")
    _save(figure, path)


def _save(figure: "mpl.figure.Figure", path: Path) -> None:
    figure.tight_layout()
    figure.savefig(path, dpi=80)
