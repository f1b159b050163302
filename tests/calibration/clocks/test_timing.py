"""`calibrate timing`: offsets to their bound, rendered swings recovered, real PTUs, and insufficient input."""

import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.stats import chi2

from calibration.clocks.calibrate import timed_rig
from calibration.clocks.html_report import turned_by_readings
from calibration.clocks.image_motion import ImageMotion, StationMotion, gather_motion
from calibration.clocks.motion_spline import CUBIC, MotionSpline
from calibration.clocks.ptu_clock_fit import TimingFit, TimingFitError, solve_timing
from calibration.flight.parameters import FLOOR_CLOCK_S
from groundstation.cli.main import main
from groundstation.rig.rig import ClockModel, Rig, load_rig
from groundstation.session import load_session
from tests.calibration.clocks.swings import Recorder, Swing, offset_bound, recorded, small_station, write_session
from tests.calibration.mount.mounts import plain_station

SIGMA_RAD = np.radians(0.01)


def held_to_the_bound(fit: TimingFit, how: Recorder, bound: float, loosest: float = 1.4) -> None:
    """Compare an offset's error with the Cramér-Rao bound, below which no sigma can be, and its sigma from both sides.

    Over nine draws of each test that uses it the fits stated 1.07 to 1.24 times the bound without a drift, and 1.42
    to 1.47 times with one; the errors came to 2.7 times the bound at most.
    """
    assert abs(fit.offset_s - how.offset_s) < 4.0 * bound
    assert 0.95 * bound < fit.sigma_s < loosest * bound


def test_offsets_are_estimated_within_bound_and_sigmas() -> None:
    swing, errors, sigmas = Swing(), [], []
    for seed in range(6):
        rng = np.random.default_rng([17, seed])
        how = Recorder(seconds=8.0, offset_s=rng.uniform(-0.08, 0.08))
        fit = solve_timing("left", *recorded(swing, how, rng), SIGMA_RAD)
        errors.append(fit.offset_s - how.offset_s)
        sigmas.append(fit.sigma_s)
    low, high = chi2.ppf([1e-4, 1 - 1e-4], len(errors))
    assert low < np.sum(np.square(np.array(errors) / sigmas)) < high
    # 1.3 times the bound, and what so many draws may be off by chance
    bound = offset_bound(swing, Recorder(seconds=8.0))
    assert np.sum(np.square(errors)) / (1.3 * bound) ** 2 < high


def test_a_drift_is_found_where_there_is_one(rng) -> None:
    how = Recorder(seconds=30.0, drift=1.5e-4)
    fit = solve_timing("left", *recorded(Swing(pan_deg=6.0), how, rng), SIGMA_RAD)
    assert fit.drift_sigma is not None
    assert fit.drift == pytest.approx(1.5e-4, abs=4.0 * fit.drift_sigma)
    assert fit.offset_s == pytest.approx(how.offset_s, abs=4.0 * fit.sigma_s)
    bound = offset_bound(Swing(pan_deg=6.0), how)
    held_to_the_bound(fit, how, bound, loosest=1.7)
    # offsets at instants spread evenly over the recording: the slope's bound is that of the mean over their rms spread
    slope_bound = bound * np.sqrt(12.0) / how.seconds
    assert abs(fit.drift - how.drift) < 4.0 * slope_bound
    assert 0.95 * slope_bound < fit.drift_sigma < 1.7 * slope_bound
    still = solve_timing("left", *recorded(Swing(pan_deg=6.0), replace(how, drift=0.0), rng), SIGMA_RAD)
    assert still.drift == 0.0


def test_errors_that_last_raise_the_sigmas_of_offset_and_drift() -> None:
    """Expected: the very errors of the turns that last for a second cost more in their order than shuffled.

    Shuffled they are white and as large, so the ratio of the sigmas is by how much errors that last raise them.
    """
    rng = np.random.default_rng([3, 1])
    how = Recorder(seconds=22.0, offset_s=0.04, frame_hz=10.0, reading_hz=30.0, reading_deg=0.003, turn_deg=0.0002)
    readings, motion = recorded(Swing(), how, rng)
    held = np.repeat(rng.normal(size=(len(motion.turn_rad) // 10 + 1, 2)), 10, axis=0)[: len(motion.turn_rad)]
    fits = [
        solve_timing("left", readings, replace(motion, turn_rad=motion.turn_rad + np.radians(0.004) * off), SIGMA_RAD)
        for off in (held, rng.permutation(held))
    ]
    lasting, white = fits
    assert white.lasting_factor < 1.3
    assert lasting.lasting_factor > 1.7
    factor = lasting.lasting_factor / white.lasting_factor
    assert lasting.sigma_s / white.sigma_s == pytest.approx(factor, rel=0.15)
    assert lasting.drift_sigma is not None
    assert white.drift_sigma is not None
    # the drift is fitted with a factor of its own, about as large
    assert lasting.drift_sigma / white.drift_sigma == pytest.approx(factor, rel=0.3)
    assert lasting.offset_s == pytest.approx(how.offset_s, abs=4.0 * lasting.sigma_s)
    # the shuffled errors were drawn larger about one axis: the bound lies between those of the two sizes
    sizes_deg = np.hypot(how.turn_deg, 0.004 * np.sqrt(np.mean(held**2, axis=0)))
    least, most = (offset_bound(Swing(), replace(how, turn_deg=size)) for size in sorted(sizes_deg))
    assert 0.95 * least < white.sigma_s < 1.4 * most
    assert abs(white.offset_s - how.offset_s) < 4.0 * most
    # ten equal errors carry as much information as one: sigmas grow by the root of ten at most
    assert lasting.lasting_factor < np.sqrt(10.0)
    assert abs(lasting.offset_s - how.offset_s) < 4.0 * np.sqrt(10.0) * least


def test_scale_and_roll_of_the_camera_do_no_harm(rng) -> None:
    how = Recorder(seconds=12.0)
    readings, motion = recorded(Swing(), how, rng)
    turned = 1.01 * motion.turn_rad @ np.array([[1.0, 0.02], [-0.02, 1.0]])
    fit = solve_timing("left", readings, replace(motion, turn_rad=turned), SIGMA_RAD)
    assert fit.scale == pytest.approx(0.01, abs=2e-3)
    assert fit.roll_rad == pytest.approx(0.02, abs=2e-3)
    assert fit.offset_s == pytest.approx(how.offset_s, abs=4.0 * fit.sigma_s)
    held_to_the_bound(fit, how, offset_bound(Swing(), how))


def test_pairs_that_do_not_fit_are_left_out(rng) -> None:
    how = Recorder(seconds=12.0)
    readings, motion = recorded(Swing(), how, rng)
    turn = motion.turn_rad.copy()
    turn[20:150:13] += np.radians(0.3)
    fit = solve_timing("left", readings, replace(motion, turn_rad=turn), SIGMA_RAD)
    assert not fit.kept[20:150:13].any()
    assert fit.offset_s == pytest.approx(how.offset_s, abs=4.0 * fit.sigma_s)
    held_to_the_bound(fit, how, offset_bound(Swing(), how))


def test_the_splines_derivatives_have_numeric_twins(rng) -> None:
    readings, motion = recorded(Swing(), Recorder(seconds=6.0, turn_deg=1e-6, reading_deg=1e-5), rng)
    t = readings[:, 0]
    knots = np.concatenate([[t[0]] * CUBIC, np.linspace(t[0], t[-1], 60), [t[-1]] * CUBIC])
    spline = MotionSpline(
        readings=readings,
        motion=motion,
        knots=knots,
        weight_reading=1.0,
        weight_turn=np.ones_like(motion.turn_rad),
        middle_s=4.0,
        with_drift=True,
    )
    p = np.array([0.023, 0.0, 0.0, 0.0])
    jacobian = spline.jacobian(p)
    for k, step in enumerate((1e-4, 1e-5, 1e-4, 1e-4)):
        d = np.zeros(4)
        d[k] = step
        numeric = (spline.residual(p + d) - spline.residual(p - d)) / (2 * step)
        size = float(np.abs(numeric).max())
        np.testing.assert_allclose(jacobian[:, k] / size, numeric / size, atol=0.02)


@pytest.mark.parametrize(
    ("swing", "how", "reported"),
    [
        (Swing(pan_deg=0.0, tilt_deg=0.0), Recorder(seconds=6.0), "moves"),
        (Swing(), Recorder(seconds=1.0), "pairs of frames"),
        (Swing(pan_hz=0.1), Recorder(seconds=20.0, frame_hz=2.0), "got pictures 0.50 s apart; wanted 0.44 s or less"),
    ],
)
def test_insufficient_data_are_refused(rng, swing: Swing, how: Recorder, reported: str) -> None:
    with pytest.raises(TimingFitError, match=reported):
        solve_timing("left", *recorded(swing, how, rng), SIGMA_RAD)


def test_a_plain_scene_is_refused(rng) -> None:
    readings, _ = recorded(Swing(), Recorder(seconds=6.0), rng)
    nothing = np.zeros((0, 2))
    plain = ImageMotion(
        from_s=nothing[:, 0], to_s=nothing[:, 0], turn_rad=nothing, sigma_rad=nothing, frames=90, plain=88, torn=2
    )
    with pytest.raises(TimingFitError, match="88 without texture"):
        solve_timing("left", readings, plain, SIGMA_RAD)


def test_readings_of_another_time_are_refused(rng) -> None:
    readings, motion = recorded(Swing(), Recorder(seconds=6.0), rng)
    readings[:, 0] += 100.0
    with pytest.raises(TimingFitError, match="same time"):
        solve_timing("left", readings, motion, SIGMA_RAD)


def test_one_ptu_clock_puts_the_difference_into_the_cameras(rng) -> None:
    stations = tuple(replace(plain_station(), name=name) for name in ("left", "right"))
    how = Recorder(seconds=6.0, offset_s=0.030)
    readings, motion = recorded(Swing(), how, rng)
    later = replace(motion, from_s=motion.from_s + 0.012, to_s=motion.to_s + 0.012)
    fits = {
        "left": solve_timing("left", readings, motion, SIGMA_RAD),
        # this camera's clock shows 12 ms more
        "right": solve_timing("right", readings, later, SIGMA_RAD),
    }
    each = timed_rig(Rig(stations=stations), fits)
    assert each["right"].ptu_clock.offset_s == pytest.approx(0.042, abs=1e-3)
    assert each["right"].camera_clock is None
    one = timed_rig(Rig(stations=stations), fits, one_ptu_clock=True)
    assert one["right"].ptu_clock.offset_s == pytest.approx(0.030, abs=1e-3)
    assert one["right"].camera_clock is not None
    assert one["right"].camera_clock.offset_s == pytest.approx(-0.012, abs=1e-3)
    assert 0.0 < one["right"].camera_clock.sigma_s < 1e-3


@pytest.mark.parametrize("readout_s", [0.0, 0.02])
def test_a_rendered_swing_gives_its_offset_back(tmp_path, rng, readout_s: float, capsys) -> None:
    stations = [small_station(), small_station("right", readout_s=readout_s)] if readout_s else [small_station()]
    how = Recorder(seconds=3.0, frame_hz=15.0, offset_s=0.040)
    folder = write_session(tmp_path / "swing", stations, Swing(pan_deg=3.0, pan_hz=0.5), how, rng)
    out = tmp_path / "timed.toml"
    code = main(["calibrate", "timing", str(folder), "--out", str(out), "--report", str(tmp_path / "report")])
    text = capsys.readouterr().out
    assert code == 0, text
    page = (tmp_path / "report" / "report.html").read_text()
    for station in stations:
        for kind in ("motion", "left-over"):
            picture = cv2.imread(str(tmp_path / "report" / f"{station.name}-{kind}.png"))
            assert picture is not None
            assert picture.std() > 10.0
    assert page.count("<img") == 2 * len(stations)
    later = [float(ms) for ms in re.findall(r"([+-][0-9.]+) ms later, as found", page)]
    # the right camera's stamps are 10 ms late
    assert later == pytest.approx([40.0, 50.0][: len(stations)], abs=0.15)
    found = load_rig(out)
    for name, offset in zip(found.names, (0.040, 0.050), strict=False):
        clock = found[name].ptu_clock
        assert clock.sigma_s < 1e-3
        assert clock.offset_s == pytest.approx(offset, abs=max(4.0 * clock.sigma_s, 2e-4)), text
        # measured: 0.12 ms off at most, the rolling shutter's; the bound is below the 0.2 ms that a rig states at least
        assert clock.offset_s == pytest.approx(offset, abs=3e-4), text
        assert FLOOR_CLOCK_S <= clock.sigma_s < 1.5 * FLOOR_CLOCK_S
    assert ("camera right against camera left" in text) == (len(stations) == 2)


def test_the_picture_shifts_the_readings_as_found(rng) -> None:
    """Readings moved by the offset turn as the pictures do; as stamped they do not."""
    how = Recorder(seconds=6.0, offset_s=0.030)
    readings, motion = recorded(Swing(), how, rng)
    one = StationMotion(station=plain_station(), readings=readings, motion=motion)
    off = [np.degrees(np.std((turned_by_readings(one, later) - motion.turn_rad)[5:-5])) for later in (0.03, 0.0)]
    assert off[0] < 1.2 * np.hypot(how.reading_deg, how.reading_deg)
    assert off[1] > 1.5 * off[0]


def test_the_bundled_landing_has_no_offset(landing_1) -> None:
    session = load_session(landing_1)
    alone = replace(session, rig=replace(session.rig, stations=session.rig.stations[1:]))
    motions = gather_motion(alone, 27.0, 31.0)
    fit = solve_timing("right", motions[0].readings, motions[0].motion, motions[0].station.angle_sigma_rad)
    assert fit.sigma_s < 0.004
    assert abs(fit.offset_s) < 4.0 * fit.sigma_s
    # measured on this recording: 0.5 ms off, 1.5 ms stated; a frame lasts 100 ms, a reading 20 ms
    assert abs(fit.offset_s) < 0.004
    assert fit.sigma_s > 0.0005


def test_spoiled_clock_model_adds_up(rng) -> None:
    how = Recorder(seconds=30.0, drift=1.5e-4, offset_s=0.02)
    readings, motion = recorded(Swing(pan_deg=6.0), how, rng)
    fit = solve_timing("left", readings, motion, SIGMA_RAD)
    before = ClockModel(offset_s=0.1, drift_ppm=50.0)
    station = replace(plain_station(), ptu_clock=before)
    after = timed_rig(Rig(stations=(station,)), {"left": fit})["left"].ptu_clock
    # the readings' session times came through the old clock: device times are those mapped back
    for session_s in (2.0, 16.0, 30.0):
        device = (session_s - before.offset_s) / (1.0 + before.drift_ppm * 1e-6)
        wanted = session_s + fit.offset_s + fit.drift * (session_s - fit.middle_s)
        assert after.session_from_device(device) == pytest.approx(wanted, abs=1e-9)


@pytest.mark.parametrize(
    ("options", "code", "reported"),
    [
        (["--detections", "d.csv"], 2, "--from-flight"),
        (["--from", "500"], 1, "frames"),
        (["--out", "x.csv"], 2, "TOML"),
    ],
)
def test_wrong_input_ends_in_one_line(
    landing_1, tmp_path, capsys, options: list[str], code: int, reported: str
) -> None:
    out = [] if "--out" in options else ["--out", str(tmp_path / "out.toml")]
    assert main(["calibrate", "timing", str(landing_1), *options, *out]) == code
    error = capsys.readouterr().err.strip().splitlines()[-1]
    assert reported in error


@pytest.mark.parametrize(
    ("options", "reported"),
    [
        (["timing", "--pictures"], "--pictures: got no --from-flight; wanted both"),
        (["timing", "--from", "nan"], "argument --from: got 'nan'; wanted a session time in s"),
        (["flight", "--to", "soon"], "argument --to: got 'soon'; wanted a session time in s"),
        (["flight", "--from", "inf"], "argument --from: got 'inf'"),
        (["flight", "--from", "300", "--to", "100"], "got --from 300 and --to 100; wanted an end after the beginning"),
        (["timing", "--from", "3", "--to", "3"], "wanted an end after the beginning"),
    ],
)
def test_wrong_usage_is_reported_before_anything_is_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], reported: str
) -> None:
    what, *more = options
    command = ["calibrate", what, str(tmp_path / "nothing"), *more, "--out", str(tmp_path / "out.toml")]
    try:
        code = main(command)
    except SystemExit as stop:
        code = stop.code
    assert code == 2
    assert reported in capsys.readouterr().err
