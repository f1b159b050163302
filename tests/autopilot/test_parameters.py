"""`groundstation autopilot check`: what is wrong with a vehicle's parameters, and the file that mends it."""

from pathlib import Path

import pytest

from groundstation.autopilot import parameter_check
from groundstation.autopilot.clock_finding import clock_finding
from groundstation.autopilot.parameter_rules import TABLE, ParameterVerdict, check_parameters, parameter_rules
from groundstation.autopilot.settings import AutopilotMode, AutopilotSettings
from groundstation.autopilot.vehicle_state import VehicleState
from groundstation.cli.main import main
from tests.autopilot.vehicles import ParameterVehicle

_ARDUPILOT, _PX4 = 3, 12
_TAKEN = [
    (_ARDUPILOT, AutopilotMode.GPS_INPUT),
    (_ARDUPILOT, AutopilotMode.VISION),
    (_ARDUPILOT, AutopilotMode.ODOMETRY),
    (_PX4, AutopilotMode.GLOBAL_POSITION),
    (_PX4, AutopilotMode.VISION),
    (_PX4, AutopilotMode.ODOMETRY),
]


def _settings(mode: AutopilotMode) -> AutopilotSettings:
    return AutopilotSettings(url="udpout:127.0.0.1:1", mode=mode)


@pytest.mark.parametrize(("autopilot", "mode"), _TAKEN)
def test_the_recommended_values_are_good_and_an_absent_one_is_said(autopilot: int, mode: AutopilotMode) -> None:
    rules = parameter_rules(autopilot, _settings(mode))
    assert not isinstance(rules, str)
    good = {rule.names[0]: rule.recommended for rule in rules}
    assert {f.finding for f in check_parameters(rules, good)} == {ParameterVerdict.OK}
    for rule in rules:
        without = {name: value for name, value in good.items() if name != rule.names[0]}
        (worst, *others) = check_parameters(rules, without)
        assert (worst.finding, worst.name) == (ParameterVerdict.UNKNOWN, rule.names[0])
        assert {f.finding for f in others} == {ParameterVerdict.OK}


def test_a_stream_has_one_rule_for_each_parameter() -> None:
    rows = [(rule.autopilot, mode, name) for rule in TABLE for mode in rule.modes for name in rule.names]
    assert len(rows) == len(set(rows))
    assert {(autopilot, mode) for autopilot, mode, _ in rows} == set(_TAKEN)


def test_the_rules_are_those_of_the_receiver_that_the_stream_stands_for() -> None:
    second = AutopilotSettings(url="udpout:127.0.0.1:1", mode=AutopilotMode.GPS_INPUT, gps_id=1)
    names = {name for rule in parameter_rules(_ARDUPILOT, second) for name in rule.names}  # type: ignore[union-attr]
    assert {"GPS2_TYPE", "GPS_TYPE2", "GPS2_DELAY_MS", "GPS_DELAY_MS2"} <= names
    assert not {"GPS1_TYPE", "GPS_TYPE", "GPS1_DELAY_MS", "GPS_DELAY_MS"} & names
    other = AutopilotSettings(url="udpout:127.0.0.1:1", mode=AutopilotMode.GLOBAL_POSITION, sensor_id=4)
    (rule,) = [r for r in parameter_rules(_PX4, other) if r.names == ("EKF2_AGP0_ID",)]  # type: ignore[union-attr]
    assert (rule.recommended, rule.accepts(4), rule.accepts(1)) == (4, True, False)


@pytest.mark.parametrize(
    ("autopilot", "mode", "name", "value", "finding"),
    [
        (_ARDUPILOT, AutopilotMode.GPS_INPUT, "GPS1_TYPE", 1, ParameterVerdict.ERROR),
        (_ARDUPILOT, AutopilotMode.GPS_INPUT, "EK3_SRC1_POSZ", 1, ParameterVerdict.ERROR),
        # a rangefinder; 2 was a receiver in EK3_ALT_SOURCE
        (_ARDUPILOT, AutopilotMode.GPS_INPUT, "EK3_SRC1_POSZ", 2, ParameterVerdict.ERROR),
        (_ARDUPILOT, AutopilotMode.GPS_INPUT, "EK3_SRC1_YAW", 2, ParameterVerdict.ERROR),
        (_ARDUPILOT, AutopilotMode.GPS_INPUT, "GPS1_DELAY_MS", 400, ParameterVerdict.ERROR),
        (_ARDUPILOT, AutopilotMode.GPS_INPUT, "EK3_BCN_DELAY", 50, ParameterVerdict.WARNING),
        (_ARDUPILOT, AutopilotMode.ODOMETRY, "EK3_BCN_DELAY", 50, ParameterVerdict.WARNING),
        (_ARDUPILOT, AutopilotMode.VISION, "VISO_QUAL_MIN", 1, ParameterVerdict.ERROR),
        (_ARDUPILOT, AutopilotMode.VISION, "EK3_SRC1_POSXY", 3, ParameterVerdict.ERROR),
        (_ARDUPILOT, AutopilotMode.ODOMETRY, "VISO_TYPE", 0, ParameterVerdict.ERROR),
        (_ARDUPILOT, AutopilotMode.ODOMETRY, "EK3_SRC1_YAW", 6, ParameterVerdict.ERROR),
        (_PX4, AutopilotMode.GLOBAL_POSITION, "EKF2_AGP0_CTRL", 1, ParameterVerdict.ERROR),
        (_PX4, AutopilotMode.GLOBAL_POSITION, "EKF2_AGP0_NOISE", 1.0, ParameterVerdict.WARNING),
        (_PX4, AutopilotMode.VISION, "EKF2_EV_CTRL", 15, ParameterVerdict.ERROR),
        (_PX4, AutopilotMode.VISION, "EKF2_HGT_REF", 1, ParameterVerdict.ERROR),
        (_PX4, AutopilotMode.ODOMETRY, "EKF2_EV_DELAY", 250, ParameterVerdict.ERROR),
        (_PX4, AutopilotMode.VISION, "EKF2_EV_DELAY", 0, ParameterVerdict.WARNING),
        (_PX4, AutopilotMode.GLOBAL_POSITION, "EKF2_AGP0_DELAY", 150, ParameterVerdict.WARNING),
        (_PX4, AutopilotMode.ODOMETRY, "EKF2_GPS_CTRL", 7, ParameterVerdict.WARNING),
    ],
)
def test_traps_are_found(
    autopilot: int, mode: AutopilotMode, name: str, value: float, finding: ParameterVerdict
) -> None:
    rules = parameter_rules(autopilot, _settings(mode))
    assert not isinstance(rules, str)
    good = {rule.names[0]: rule.recommended for rule in rules}
    assert name in good
    (worst, *others) = check_parameters(rules, good | {name: value})
    assert (worst.finding, worst.name) == (finding, name)
    assert {f.finding for f in others} == {ParameterVerdict.OK}


@pytest.mark.parametrize(
    ("value", "finding"), [(2.0, ParameterVerdict.OK), (3.0, ParameterVerdict.ERROR), (0.0, ParameterVerdict.ERROR)]
)
def test_the_older_name_of_the_height_source_counts_otherwise(value: float, finding: ParameterVerdict) -> None:
    """EK3_ALT_SOURCE: 0 barometer, 1 rangefinder, 2 GPS, 3 range beacon. Expected: 2 is good and recommended."""
    rules = parameter_rules(_ARDUPILOT, _settings(AutopilotMode.GPS_INPUT))
    assert not isinstance(rules, str)
    (found,) = [f for f in check_parameters(rules, {"EK3_ALT_SOURCE": value}) if f.name == "EK3_ALT_SOURCE"]
    assert (found.finding, found.recommended) == (finding, 2)


@pytest.mark.parametrize(
    ("autopilot", "mode", "wanted"),
    [
        (_ARDUPILOT, AutopilotMode.GLOBAL_POSITION, "gps_input"),
        (_PX4, AutopilotMode.GPS_INPUT, "global_position"),
        (0, AutopilotMode.VISION, "type 0"),
    ],
)
def test_a_mode_that_the_autopilot_does_not_take_is_refused(autopilot: int, mode: AutopilotMode, wanted: str) -> None:
    assert wanted in str(parameter_rules(autopilot, _settings(mode)))


def test_a_vehicle_is_asked_and_the_file_mends_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rules = parameter_rules(_ARDUPILOT, _settings(AutopilotMode.GPS_INPUT))
    assert not isinstance(rules, str)
    values: dict[str, float | int] = {rule.names[0]: int(rule.recommended) for rule in rules}
    # an older firmware's names, and the barometer's height
    del values["GPS1_TYPE"], values["EK3_POSNE_M_NSE"]
    values |= {"GPS_TYPE": 1, "EK3_SRC1_POSZ": 1, "EK3_POSNE_M_NSE": 0.3}
    out = tmp_path / "vehicle.parm"
    with ParameterVehicle(_ARDUPILOT, values) as vehicle:
        code = main(["autopilot", "check", vehicle.url, "--mode", "gps_input", "--out", str(out)])
    printed = capsys.readouterr()
    assert code == 1
    assert "ArduPilot, system 7" in printed.out
    errors = [line for line in printed.out.splitlines() if line.startswith("error")]
    assert [line.split()[1] for line in errors] == ["GPS_TYPE", "EK3_SRC1_POSZ"]
    assert "ignore or misuse" in printed.err
    written = dict(line.split(",") for line in out.read_text().splitlines())
    assert (written["GPS_TYPE"], written["EK3_SRC1_POSZ"], written["EK3_POSNE_M_NSE"]) == ("14", "3", "0.3")
    with ParameterVehicle(_ARDUPILOT, values | {name: float(value) for name, value in written.items()}) as vehicle:
        assert main(["autopilot", "check", vehicle.url, "--mode", "gps_input"]) == 0


def test_px4s_integers_are_read(capsys: pytest.CaptureFixture[str]) -> None:
    rules = parameter_rules(_PX4, _settings(AutopilotMode.GLOBAL_POSITION))
    assert not isinstance(rules, str)
    whole = ("EKF2_AGP0_ID", "EKF2_AGP0_CTRL")
    values: dict[str, float | int] = {
        r.names[0]: int(r.recommended) if r.names[0] in whole else float(r.recommended) for r in rules
    }
    with ParameterVehicle(_PX4, values) as vehicle:
        assert main(["autopilot", "check", vehicle.url, "--mode", "global_position"]) == 0
    assert "EKF2_AGP0_CTRL = 3" in capsys.readouterr().out


def test_a_vehicle_that_does_not_tell_its_time_is_said(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: one that answers is good; of another what the delay then costs is said, by autopilot."""
    for autopilot, mode, words in (
        (_ARDUPILOT, AutopilotMode.GPS_INPUT, "late by that of the fastest message: 2.5 m for 100 ms"),
        (_PX4, AutopilotMode.VISION, "PX4 takes each position for as old as its arrival"),
    ):
        rules = parameter_rules(autopilot, _settings(mode))
        assert not isinstance(rules, str)
        values = {rule.names[0]: float(rule.recommended) for rule in rules}
        for tells_time in (True, False):
            # a wait for an answer ends with it
            monkeypatch.setattr(parameter_check, "_CLOCK_EVERY_S", 60.0 if tells_time else 0.05)
            with ParameterVehicle(autopilot, values, tells_time=tells_time) as vehicle:
                assert main(["autopilot", "check", vehicle.url, "--mode", str(mode)]) == 0
            (line,) = [line for line in capsys.readouterr().out.splitlines() if "TIMESYNC" in line]
            assert ("no answer" in line and words in line) is not tells_time


@pytest.mark.parametrize(
    ("autopilot", "trip_s", "stated_s", "finding", "words"),
    [
        (_ARDUPILOT, 0.16, None, ParameterVerdict.OK, "from 160 ms on"),
        (_PX4, 0.008, None, ParameterVerdict.OK, "from 8 ms on"),
        (_PX4, 0.16, None, ParameterVerdict.WARNING, "below 10 ms only"),
        (_ARDUPILOT, None, 0.08, ParameterVerdict.WARNING, "what link_delay_s states, 80 ms"),
        (_PX4, None, None, ParameterVerdict.WARNING, "as old as its arrival"),
    ],
)
def test_what_answers_to_timesync_mean(
    autopilot: int, trip_s: float | None, stated_s: float | None, finding: ParameterVerdict, words: str
) -> None:
    vehicle = VehicleState(system=7, autopilot=autopilot)
    for _ in range(5 if trip_s is not None else 0):
        vehicle.link_delay.answered(1.0, 9.0, 1.0 + (trip_s or 0.0))
    stream = AutopilotSettings(url="udpout:127.0.0.1:1", mode=AutopilotMode.VISION, link_delay_s=stated_s)
    found = clock_finding(stream, vehicle)
    assert found.finding is finding
    assert words in found.text()


@pytest.mark.parametrize(("answers", "words"), [(1, "stays (0.25 m for"), (5, "stays (0.25 m for"), (60, "one sigma)")])
def test_a_variation_of_the_delay_is_stated_once_it_is_known(answers: int, words: str) -> None:
    """Expected: not of few answers, of which the figure would be what is assumed of a radio; then what was observed."""
    vehicle = VehicleState(system=7, autopilot=_PX4)
    for k in range(answers):
        late_s = 0.03 * (-1) ** k
        vehicle.link_delay.answered(float(k), 9.0 + k + late_s, k + 0.16)
    text = clock_finding(_settings(AutopilotMode.VISION), vehicle).text()
    assert words in text
    assert ("stays (30 ms, 0.7 m at 25 m/s" in text) is (answers == 60)


def test_no_vehicle_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    code = main(["autopilot", "check", "udpout:127.0.0.1:9", "--mode", "vision", "--patience", "0.2"])
    assert code == 1
    assert "no vehicle's heartbeat in 0.2 s" in capsys.readouterr().err


def test_without_a_mode_it_is_wrong_usage(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["autopilot", "check", "udpout:127.0.0.1:9"]) == 2
    assert "mode of the autopilot" in capsys.readouterr().err
