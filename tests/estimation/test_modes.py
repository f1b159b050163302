"""Two ways of flying in one filter: weights follow the flight, one mode alone is the plain filter."""

import numpy as np
import pytest
from scipy.stats import chi2, multivariate_normal

from groundstation.estimation.filterpy_ekf import FilterpyEkf
from groundstation.estimation.imm import ImmFilter, ImmState
from groundstation.estimation.kalman_kernels import LinearMeasurement

F = np.array([[1.0, 0.1], [0.0, 1.0]])
H, R = np.array([[1.0, 0.0]]), np.array([[0.04]])
ALL = np.ones(2, np.bool_)


def noise(psd: float, dt: float = 0.1) -> np.ndarray:
    return psd * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])


def started(stay_s: tuple[float, ...]) -> ImmFilter:
    bank = ImmFilter(2, stay_s)
    bank.set_states(slice(0, 2), np.zeros(2), np.diag([1.0, 4.0]))
    return bank


def test_one_mode_is_the_plain_filter(rng: np.random.Generator) -> None:
    bank, plain = started((5.0,)), FilterpyEkf(np.zeros(2), np.diag([1.0, 4.0]))
    for _ in range(30):
        bank.predict(F, [noise(0.3)], 0.1)
        plain.set_motion(F, noise(0.3))
        plain.predict()
        residual = rng.normal(size=1)
        bank.correct(LinearMeasurement(residual, H, R), ALL, updates_weights=True)
        plain.set_measurement(LinearMeasurement(residual, H, R))
        plain.update(residual)
    np.testing.assert_allclose(bank.x, plain.x, rtol=1e-9)
    np.testing.assert_allclose(bank.P, plain.P, rtol=1e-9)


def fly(bank: ImmFilter, modes: list[np.ndarray], acceleration: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return per step: error squared in sigmas (2 dof), position error and the second mode's weight."""
    truth, out = np.zeros(2), []
    for a in acceleration:
        truth = F @ truth + a
        bank.predict(F, modes, 0.1)
        z = truth[:1] + rng.normal(0, 0.2, 1)
        bank.correct(LinearMeasurement(z - bank.x[:1], H, R), ALL, updates_weights=True)
        e = truth - bank.x
        weight = float(bank.weights[-1]) if len(modes) > 1 else 0.0
        out.append((float(e @ np.linalg.solve(bank.P, e)), float(e[0]), weight))
    return np.array(out)


def test_a_glide_is_as_quiet_and_a_flare_as_quick_as_with_the_right_filter(rng: np.random.Generator) -> None:
    modes = [noise(0.02), noise(20.0)]
    calm_rms, jump_rms, weights = {"both": [], "calm": []}, {"both": [], "quick": []}, []
    squares, alone = [], []
    for _ in range(60):
        # white acceleration of the calm kind, then two seconds of hard braking
        steps = rng.multivariate_normal(np.zeros(2), modes[0], 120)
        steps[80:100] += np.array([0.5 * 0.1**2, 0.1]) * 6.0
        seed = int(rng.integers(2**31))
        runs = {
            name: fly(started(stay), chosen, steps, np.random.default_rng(seed))
            for name, stay, chosen in (
                ("both", (20.0, 2.0), modes),
                ("calm", (1.0,), modes[:1]),
                ("quick", (1.0,), modes[1:]),
            )
        }
        for name, kept in calm_rms.items():
            kept.append(runs[name][30:80, 1] ** 2)
        for name, kept in jump_rms.items():
            # from half a second after: a manoeuvre has to be seen before it can be followed
            kept.append(runs[name][85:100, 1] ** 2)
        weights.append(runs["both"][:, 2])
        squares += list(runs["both"][30:80:10, 0])
        alone += list(runs["calm"][30:80:10, 0])
    rms = {name: np.sqrt(np.mean(kept)) for name, kept in calm_rms.items()}
    assert rms["both"] < 1.1 * rms["calm"]
    rms = {name: np.sqrt(np.mean(kept)) for name, kept in jump_rms.items()}
    assert rms["both"] < 1.15 * rms["quick"]
    weight = np.mean(weights, axis=0)
    assert weight[30:80].mean() < 0.2
    assert weight[85:100].mean() > 0.6
    # on the calm part the truth is drawn from the calm mode: its own filter is right, and the mixture, which holds
    # the other for possible, supposes up to twice the variance
    low, high = chi2.ppf([0.001, 0.999], 2 * len(squares)) / len(squares)
    assert low < np.mean(alone) < high
    assert 0.5 * low < np.mean(squares) < high


def test_flights_that_follow_the_modes_are_consistent(rng: np.random.Generator) -> None:
    """Truth drawn from the modes and their changes: mean of the squared errors inside two-sided χ² bounds."""
    modes, stay_s, squares = [noise(0.02), noise(20.0)], (20.0, 2.0), []
    for _ in range(60):
        flying, steps = int(rng.random() < stay_s[1] / sum(stay_s)), []
        for _ in range(100):
            if rng.random() < 1.0 - np.exp(-0.1 / stay_s[flying]):
                flying = 1 - flying
            steps.append(rng.multivariate_normal(np.zeros(2), modes[flying]))
        squares += list(fly(started(stay_s), modes, np.array(steps), rng)[9:100:18, 0])
    low, high = chi2.ppf([0.001, 0.999], 2 * len(squares)) / len(squares)
    # between its modes the truth is no Gaussian: an approximation of the mixture may be off by a tenth
    assert 0.9 * low < np.mean(squares) < 1.1 * high


def test_a_snapshot_brings_everything_back(rng: np.random.Generator) -> None:
    bank, modes = started((10.0, 2.0)), [noise(0.02), noise(20.0)]
    fly(bank, modes, rng.normal(0, 0.1, (10, 2)), rng)
    saved = bank.state
    before = (bank.x.copy(), bank.P.copy(), bank.weights.copy())
    fly(bank, modes, rng.normal(0, 0.1, (10, 2)), rng)
    bank.state = saved
    for a, b in zip(before, (bank.x, bank.P, bank.weights), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("stay_s", [(5.0,), (10.0, 2.0)])
def test_doubt_adds_to_variances_and_leaves_a_snapshot_alone(
    rng: np.random.Generator, stay_s: tuple[float, ...]
) -> None:
    bank, modes = started(stay_s), [noise(0.02), noise(20.0)][: len(stay_s)]
    fly(bank, modes, rng.normal(0, 0.1, (10, 2)), rng)
    saved, x, P = bank.state, bank.x.copy(), bank.P.copy()
    bank.inflate(slice(1, 2), np.array([3.0]))
    np.testing.assert_allclose(bank.x, x)
    np.testing.assert_allclose(bank.P, P + np.diag([0.0, 3.0]))
    # and it is what the next step starts from
    bank.predict(np.eye(2), [np.zeros((2, 2))] * len(stay_s), 1e-9)
    np.testing.assert_allclose(bank.P, P + np.diag([0.0, 3.0]), rtol=1e-6)
    bank.state = saved
    np.testing.assert_array_equal(bank.P, P)


def gaussian(residual: np.ndarray, covariance: np.ndarray) -> float:
    return float(multivariate_normal(np.zeros(len(residual)), covariance).pdf(residual))


class Textbook:
    """The interacting multiple model filter of Bar-Shalom, Li and Kirubarajan (2001), section 11.6.6, in plain sums."""

    def __init__(self, x: list[np.ndarray], P: list[np.ndarray], weights: list[float], stay_s: list[float]) -> None:
        self.x, self.P, self.weights, self.stay_s = x, P, np.array(weights), stay_s

    @staticmethod
    def mixed(weights: np.ndarray, x: list[np.ndarray], P: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        mean = sum(w * each for w, each in zip(weights, x, strict=True))
        spread = sum(w * (C + np.outer(each - mean, each - mean)) for w, each, C in zip(weights, x, P, strict=True))
        return np.asarray(mean), np.asarray(spread)

    def mixture(self) -> tuple[np.ndarray, np.ndarray]:
        return self.mixed(self.weights, self.x, self.P)

    def predict(self, F: np.ndarray, noises: list[np.ndarray], dt_s: float) -> None:
        r = len(self.x)
        change = np.full((r, r), 0.0)
        for i in range(r):
            leave = 1.0 - np.exp(-dt_s / self.stay_s[i])
            for j in range(r):
                change[i, j] = 1.0 - leave if i == j else leave / (r - 1)
        after = change.T @ self.weights
        begun = [self.mixed(change[:, j] * self.weights / after[j], self.x, self.P) for j in range(r)]
        self.x = [F @ x for x, _ in begun]
        self.P = [F @ P @ F.T + Q for (_, P), Q in zip(begun, noises, strict=True)]
        self.weights = after

    def correct(self, z: np.ndarray, H: np.ndarray, R: np.ndarray, *, updates_weights: bool) -> None:
        likely = []
        for k, (x, P) in enumerate(zip(self.x, self.P, strict=True)):
            S = H @ P @ H.T + R
            K = P @ H.T @ np.linalg.inv(S)
            likely.append(gaussian(z - H @ x, S))
            self.x[k] = x + K @ (z - H @ x)
            self.P[k] = P - K @ S @ K.T
        if updates_weights:
            self.weights = self.weights * likely / np.sum(self.weights * likely)


@pytest.mark.parametrize("modes", [2, 3])
def test_it_is_the_textbooks_filter_step_by_step(rng: np.random.Generator, modes: int) -> None:
    """Expected: states, covariances and weights of all modes and of their mixture, modes that stand far apart at first.

    What is mixed keeps the spread of the modes' means, along both states and across them.
    """
    n, stay_s = 3, [4.0, 1.5, 0.7][:modes]
    x = [rng.normal(0.0, 2.0, n) for _ in range(modes)]
    roots = [rng.normal(size=(n, n)) for _ in range(modes)]
    weights = [0.5, 0.3, 0.2][:modes] if modes == 3 else [0.65, 0.35]
    wanted = Textbook(list(x), [root @ root.T + 0.1 * np.eye(n) for root in roots], weights, stay_s)
    bank = ImmFilter(n, stay_s)
    bank.state = ImmState.mixed(np.array(wanted.x), np.array(wanted.P), np.array(weights))
    transition = np.array([[1.0, 0.3, 0.04], [0.0, 1.0, 0.3], [0.0, 0.0, 1.0]])
    noises = [np.diag([0.01, 0.02, 0.03]) * 8.0**k for k in range(modes)]
    H, R = np.array([[1.0, 0.0, 0.2], [0.0, 0.5, -1.0]]), np.array([[0.3, 0.1], [0.1, 0.5]])

    def agree() -> None:
        mean, spread = wanted.mixture()
        np.testing.assert_allclose(bank.x, mean, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(bank.P, spread, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(bank.weights, wanted.weights, rtol=1e-9)
        states, covariances = bank.state.states, bank.state.covariances
        np.testing.assert_allclose(states, wanted.x, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(covariances, wanted.P, rtol=1e-9, atol=1e-12)

    agree()
    for k, dt_s in enumerate((0.3, 0.1, 1.0, 0.3)):
        np.testing.assert_allclose(bank.weights_after(dt_s), _weights_after(wanted, dt_s), rtol=1e-9)
        bank.predict(transition, noises, dt_s)
        wanted.predict(transition, noises, dt_s)
        agree()
        z, updates_weights = H @ wanted.mixture()[0] + rng.normal(0.0, 0.7, 2), k != 1
        bank.correct(LinearMeasurement(z - H @ bank.x, H, R), np.ones(n, np.bool_), updates_weights=updates_weights)
        wanted.correct(z, H, R, updates_weights=updates_weights)
        agree()


def _weights_after(textbook: Textbook, dt_s: float) -> np.ndarray:
    copy = Textbook(textbook.x, textbook.P, list(textbook.weights), textbook.stay_s)
    copy.predict(np.eye(3), [np.zeros((3, 3))] * len(copy.x), dt_s)
    return copy.weights


def test_the_mixture_is_as_wide_as_its_modes_are_apart() -> None:
    """Expected: two modes known exactly, a metre and 3 m/s apart: variance w(1 − w)·d², also of what starts from it."""
    d, weights = np.array([1.0, 3.0]), np.array([0.25, 0.75])
    bank = ImmFilter(2, (1.0, 1.0))
    bank.state = ImmState.mixed(np.array([np.zeros(2), d]), np.zeros((2, 2, 2)), weights)
    np.testing.assert_allclose(bank.x, 0.75 * d)
    np.testing.assert_allclose(bank.P, 0.1875 * np.outer(d, d))
    # over so long a change is as likely as none: each mode starts from the whole mixture
    bank.predict(np.eye(2), [np.zeros((2, 2))] * 2, np.log(2.0))
    np.testing.assert_allclose(bank.weights, [0.5, 0.5])
    states, covariances = bank.state.states, bank.state.covariances
    for x, P in zip(states, covariances, strict=True):
        np.testing.assert_allclose(x, 0.75 * d)
        np.testing.assert_allclose(P, 0.1875 * np.outer(d, d))
