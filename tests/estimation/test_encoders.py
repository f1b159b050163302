"""PTU readings on their way into the filter: a jerk is followed, a spike is dropped and counted."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from groundstation.estimation.config import EstimationConfig
from groundstation.estimation.encoders import EncoderFeed
from groundstation.estimation.implementation import filter_arithmetic
from groundstation.estimation.journal import FilterJournal
from groundstation.estimation.late_measurements import LateMeasurementBuffer
from groundstation.estimation.parameters import ParameterPrior
from groundstation.estimation.station_ekf import StationEkf
from groundstation.messages import PtuSample
from tests.stereo_rig import make_rig


def feed(config: EstimationConfig | None = None) -> tuple[StationEkf, EncoderFeed]:
    rig = make_rig()
    config = config or EstimationConfig()
    ekf = StationEkf({s.name: s.geometry() for s in rig.stations}, rig.names, config)
    return ekf, EncoderFeed(ekf, {s.name: s for s in rig.stations}, config)


def read(ekf: StationEkf, encoders: EncoderFeed, t: float, pan_deg: float, tilt_deg: float = 0.0) -> str | None:
    ekf.predict_to(t)
    sample = PtuSample(t_s=t, station="left", pan_rad=math.radians(pan_deg), tilt_rad=math.radians(tilt_deg))
    return encoders.read(sample)


def test_a_steady_turn_is_followed() -> None:
    ekf, encoders = feed()
    for k in range(100):
        assert read(ekf, encoders, k * 0.02, 5.0 * k * 0.02) is None
    assert ekf.angles("left")[0] == pytest.approx(math.radians(5.0 * 99 * 0.02), abs=1e-4)
    assert math.degrees(ekf.state[ekf.layout.rates["left"].start]) == pytest.approx(5.0, abs=0.1)
    assert encoders.spikes == 0


def test_a_spike_is_dropped_and_counted() -> None:
    ekf, encoders = feed()
    for k in range(50):
        read(ekf, encoders, k * 0.02, 1.0)
    assert read(ekf, encoders, 1.0, 46.0) is None, "held back, not judged yet"
    assert abs(math.degrees(ekf.angles("left")[0]) - 1.0) < 0.01
    reported = read(ekf, encoders, 1.02, 1.0)
    assert reported is not None
    assert "dropped" in reported
    assert encoders.spikes == 1
    assert abs(math.degrees(ekf.angles("left")[0]) - 1.0) < 0.01


def test_a_stall_is_accepted_at_the_next_reading() -> None:
    """The PTU stops dead from 16 °/s: uncertain for one reading, right again with the second."""
    ekf, encoders = feed()
    for k in range(50):
        read(ekf, encoders, k * 0.02, 16.0 * k * 0.02)
    stop = 16.0 * 49 * 0.02
    read(ekf, encoders, 1.0, stop)
    sigma = math.degrees(encoders.sigma_rad("left"))
    assert abs(math.degrees(ekf.angles("left")[0]) - stop) < 2 * sigma, "the doubt covers the error"
    # the filter has gone on by 16 °/s for the 0.02 s between two readings, and doubts itself by that and no more
    jump = 16.0 * 0.02
    assert math.degrees(ekf.angles("left")[0]) - stop == pytest.approx(jump, abs=0.02)
    assert sigma == pytest.approx(jump, rel=0.1)
    reported = read(ekf, encoders, 1.02, stop)
    assert reported is not None
    assert "confirmed" in reported
    assert math.degrees(ekf.angles("left")[0]) == pytest.approx(stop, abs=0.01)
    assert encoders.spikes == 0


def test_a_full_turn_is_not_a_jump() -> None:
    ekf, encoders = feed()
    for k in range(50):
        pan = 179.0 + 2.0 * k * 0.02
        assert read(ekf, encoders, k * 0.02, pan if pan < 180 else pan - 360) is None
    assert np.isfinite(ekf.state).all()


def test_readings_of_an_unknown_station_are_ignored() -> None:
    _, encoders = feed()
    assert encoders.read(PtuSample(t_s=0.0, station="unknown", pan_rad=0.0, tilt_rad=0.0)) is None


def test_a_head_that_speeds_up_while_it_turns_fast_has_no_spike() -> None:
    """From 45 °/s on it gains 200 °/s each second: jerks, confirmed, by what it strays from a steady turn."""
    ekf, encoders = feed()
    for k in range(50):
        read(ekf, encoders, k * 0.02, 45.0 * k * 0.02)
    at, reported = 49 * 0.02, []
    for k in range(1, 15):
        t = k * 0.02
        reported.append(read(ekf, encoders, at + t, 45.0 * (at + t) + 100.0 * t**2))
    heard = [line for line in reported if line is not None]
    assert heard
    assert all("confirmed" in line for line in heard)
    assert "a jerk of 0.04" in heard[0], "half of 200 °/s² over 0.02 s, not the way of 0.9° to the next reading"
    assert encoders.spikes == 0


def test_a_spike_of_a_head_that_turns_fast_is_dropped() -> None:
    ekf, encoders = feed()
    for k in range(50):
        read(ekf, encoders, k * 0.02, 45.0 * k * 0.02)
    assert read(ekf, encoders, 1.0, 45.0 + 3.0) is None
    reported = read(ekf, encoders, 1.02, 45.0 * 1.02)
    assert reported is not None
    assert "dropped, 3.000° off" in reported
    assert encoders.spikes == 1


def jerk(rate_deg_s: float, config: EstimationConfig, axis: str = "pan") -> tuple[str, int, float]:
    """A head at rest jumps by 2° and turns on at a rate: the log lines, the spikes, and the angle then, deg."""
    ekf, encoders = feed(config)

    def at(t: float, angle_deg: float) -> str | None:
        ekf.predict_to(t)
        angles = {"pan_rad": 0.0, "tilt_rad": 0.0, f"{axis}_rad": math.radians(angle_deg)}
        return encoders.read(PtuSample(t_s=t, station="left", **angles))

    for k in range(50):
        assert at(0.02 * k, 0.0) is None
    assert at(1.0, math.copysign(2.0, rate_deg_s)) is None
    reported = at(1.02, math.copysign(2.0, rate_deg_s) + 0.02 * rate_deg_s)
    assert reported is not None
    return reported, encoders.spikes, math.degrees(ekf.angles("left")[axis == "tilt"])


@pytest.mark.parametrize("axis", ["pan", "tilt"])
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("most_deg_s", [30.0, 120.0])
def test_what_is_faster_than_any_ptu_is_a_spike(axis: str, sign: float, most_deg_s: float) -> None:
    """Expected: `ptu_max_rate_deg_s` decides, in degrees per second, of either axis and way."""
    config = replace(EstimationConfig(), ptu_max_rate_deg_s=most_deg_s)
    rate = 0.9 * sign * most_deg_s
    reported, spikes, angle = jerk(rate, config, axis)
    assert "confirmed by the next reading" in reported
    assert spikes == 0
    assert angle == pytest.approx(2.0 * sign + 0.02 * rate, abs=0.01)
    reported, spikes, _ = jerk(1.1 * sign * most_deg_s, config, axis)
    assert "dropped, 2.000° off and not confirmed" in reported
    assert spikes == 1


@pytest.mark.parametrize("value", [0.0, -120.0, 1e10, math.inf, -math.inf, math.nan])
def test_a_greatest_rate_that_is_none_is_refused(value: float) -> None:
    with pytest.raises(ValueError, match="ptu_max_rate_deg_s"):
        replace(EstimationConfig(), ptu_max_rate_deg_s=value)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_jerk_across_half_a_turn_is_a_jerk(sign: float) -> None:
    """Expected: from 179° by 2° and 0.4° on, read as −178.6°, is no turn of 358°."""
    ekf, encoders = feed()
    for k in range(50):
        read(ekf, encoders, 0.02 * k, sign * 178.5)
    assert read(ekf, encoders, 1.0, sign * 179.9) is None
    reported = read(ekf, encoders, 1.02, -sign * 179.1)
    assert reported is not None
    assert "confirmed" in reported
    assert encoders.spikes == 0


def test_a_picture_s_angles_count_by_their_own_sigma_and_are_no_reading() -> None:
    """Expected: ten times better than an encoder's, the filter takes them; one that is far off changes nothing."""
    ekf, encoders = feed()
    for k in range(50):
        read(ekf, encoders, k * 0.02, 1.0)
    better = math.radians(1.004)
    sample = PtuSample(t_s=0.98, station="left", pan_rad=better, tilt_rad=0.0, sigma_rad=1e-6)
    assert encoders.read(sample) is None
    assert ekf.angles("left")[0] == pytest.approx(better, abs=1e-6)
    assert encoders.age_s("left", 1.0) == pytest.approx(0.02)
    far = PtuSample(t_s=0.98, station="left", pan_rad=math.radians(3.0), tilt_rad=0.0, sigma_rad=1e-6)
    assert encoders.read(far) is None
    assert ekf.angles("left")[0] == pytest.approx(better, abs=1e-5)
    assert not encoders.is_doubtful("left")
    assert encoders.spikes == 0


@pytest.mark.parametrize("delay_s", [0.005, -0.005])
def test_a_picture_s_angles_are_of_the_exposure_of_its_rows(delay_s: float) -> None:
    """Expected: a head that turns is where the filter has it, to the filter's sigma, in pan and in rate.

    The picture of a frame is fused at the frame's stamp and tells of `delay_s` later: at 5 °/s of 0.025° farther.
    """
    rng, rate, squares = np.random.default_rng(12), math.radians(5.0), []
    sigma_encoder, sigma_picture = math.radians(0.02), math.radians(0.002)
    stations = tuple(replace(s, ptu_sigma_rad=sigma_encoder, ptu_resolution_rad=0.0) for s in make_rig().stations)
    for _ in range(40):
        config = EstimationConfig()
        ekf = StationEkf({s.name: s.geometry() for s in stations}, ("left", "right"), config)
        encoders = EncoderFeed(ekf, {s.name: s for s in stations}, config)
        # white acceleration of the model's own density
        pan, speed, dt = 0.0, rate, 0.02
        Q = config.ptu_acceleration_psd_rad2_s3 * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        for k in range(60):
            step = rng.multivariate_normal(np.zeros(2), Q)
            pan, speed = pan + dt * speed + step[0], speed + step[1]
            t_s = dt * k
            ekf.predict_to(t_s)
            read_rad = pan + sigma_encoder * rng.standard_normal()
            encoders.read(PtuSample(t_s=t_s, station="left", pan_rad=read_rad, tilt_rad=0.0))
            told_rad = pan + delay_s * speed + sigma_picture * rng.standard_normal()
            encoders.read(
                PtuSample(t_s=t_s + delay_s, station="left", pan_rad=told_rad, tilt_rad=0.0, sigma_rad=sigma_picture)
            )
        angle, turn = ekf.layout.angles["left"].start, ekf.layout.rates["left"].start
        off = np.array([pan - ekf.state[angle], speed - ekf.state[turn]])
        places = np.ix_([angle, turn], [angle, turn])
        squares.append(float(off @ np.linalg.solve(ekf.covariance[places], off)))
        head = encoders.rates("left")
        assert head.pan_rad_s == ekf.state[turn]
        assert head.sigma_rad_s >= math.sqrt(ekf.covariance[turn, turn])
    low, high = chi2.ppf([0.0005, 0.9995], 2 * len(squares))
    assert low < sum(squares) < high
    assert encoders.spikes == 0


@pytest.mark.parametrize("delay_s", [0.0, 0.004, -0.004])
def test_a_late_reading_leaves_a_picture_s_angles_with_their_frame(delay_s: float) -> None:
    """Expected: a frame's next reading that comes after the one after it ends as if it had come in order."""

    def reading(t_s: float) -> PtuSample:
        return PtuSample(t_s=t_s, station="left", pan_rad=0.1 * t_s + 1e-4 * math.cos(500.0 * t_s), tilt_rad=0.0)

    def flown(*, late: bool) -> StationEkf:
        rig, config = make_rig(), EstimationConfig()
        journal = FilterJournal(filter_arithmetic(config.implementation).smooth_across)
        geometries = {s.name: s.geometry() for s in rig.stations}
        ekf = StationEkf(geometries, rig.names, config, ParameterPrior.nothing(), journal)
        buffer = LateMeasurementBuffer(
            ekf,
            journal,
            EncoderFeed(ekf, {s.name: s for s in rig.stations}, config),
            stations=rig.names,
            horizon_s=0.5,
            max_entries=100,
            max_gap_s=0.25,
            log=lambda t_s, text: None,
        )

        def alone(t_s: float) -> None:
            with buffer.reading(t_s, "left"):
                ekf.predict_to(t_s)
                buffer.read(reading(t_s))

        for k in range(4):
            alone(0.01 * k)
        told = PtuSample(t_s=0.035 + delay_s, station="left", pan_rad=0.0035, tilt_rad=0.0, sigma_rad=1e-5)
        with buffer.frame(0.035, "left"):
            ekf.predict_to(0.035)
            buffer.read(reading(0.05 if late else 0.04))
            buffer.read(told)
        if late:
            buffer.late_reading(reading(0.04), lambda sample: False)
        else:
            alone(0.05)
        alone(0.06)
        return ekf

    ordered, late = flown(late=False), flown(late=True)
    np.testing.assert_allclose(late.state, ordered.state, rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(late.covariance, ordered.covariance, rtol=1e-12, atol=0.0)
