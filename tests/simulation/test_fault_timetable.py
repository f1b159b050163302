"""The timetable of `simulate --faults` on a range that flies in real time."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from groundstation.cli.main import main
from groundstation.errors import InputError
from groundstation.rig.rig import Rig
from groundstation.simulation.approach import GlideApproach
from groundstation.simulation.device_faults import CAMERA_LATE, CAMERA_LOST, PTU_SILENT, TimedFault, size_s
from groundstation.simulation.event_faults import FaultKind
from groundstation.simulation.fault_timetable import check_timetable, simulated_device_faults
from groundstation.simulation.render_flight import load_faults
from groundstation.simulation.simulated_receiver import SIMULATED_ORIGIN, ReceiverModel, SimulatedReceiver, sentences
from tests.stereo_rig import make_rig

SIZED = (FaultKind.CAMERA_LATE, FaultKind.CAMERA_CLOCK_STEP, FaultKind.PTU_CLOCK_STEP, FaultKind.DGPS_CLOCK_STEP)
FILE = """
[[fault]]
what = "camera_lost"
station = "left"
from_s = 5.0
to_s = 7.0
[[fault]]
what = "camera_late"
station = "right"
from_s = 6.0
by_s = 0.3
[[fault]]
what = "ptu_silent"
station = "left"
from_s = 9.0
[[fault]]
what = "dgps_gap"
from_s = 8.0
to_s = 9.0
[[fault]]
what = "dgps_clock_step"
from_s = 10.0
to_s = 11.0
by_s = 2.5
"""


def test_each_fault_finds_its_device(tmp_path: Path) -> None:
    path = tmp_path / "faults.toml"
    path.write_text(FILE)
    found = simulated_device_faults(load_faults(path), ReceiverModel(), str(path))
    assert found.timetable == (
        TimedFault(what=CAMERA_LOST, station="left", from_s=5.0, to_s=7.0, by_s=0.0),
        TimedFault(what=CAMERA_LATE, station="right", from_s=6.0, to_s=float("inf"), by_s=0.3),
        TimedFault(what=PTU_SILENT, station="left", from_s=9.0, to_s=float("inf"), by_s=0.0),
    )
    assert found.receiver == replace(ReceiverModel(), gone_s=((8.0, 9.0),), stepped_s=((10.0, 11.0, 2.5),))
    check_timetable(found.timetable, make_rig())


def test_every_kind_is_known_or_refused_in_one_line(tmp_path: Path) -> None:
    for kind in FaultKind:
        path = tmp_path / f"{kind}.toml"
        by = "by_deg = 1" if kind is FaultKind.PTU_SPIKE else "by_s = 0.1" if kind in SIZED else ""
        station = "" if kind.startswith("dgps") else 'station = "left"\n'
        path.write_text(f'[[fault]]\nwhat = "{kind}"\nfrom_s = 1\n{station}{by}\n')
        faults = load_faults(path)
        if kind in (FaultKind.PTU_SPIKE, FaultKind.PTU_STUCK, FaultKind.PTU_CLOCK_STEP):
            with pytest.raises(InputError, match=f"got {kind}; wanted one of camera_lost, .*--ptu-fault"):
                simulated_device_faults(faults, ReceiverModel(), str(path))
        else:
            found = simulated_device_faults(faults, ReceiverModel(), str(path))
            assert len(found.timetable) + (found.receiver != ReceiverModel()) == 1


def test_faults_of_a_kind_add_up_while_they_are_there() -> None:
    late = [TimedFault(what=CAMERA_LATE, station="left", from_s=1.0 * k, to_s=3.0, by_s=0.1) for k in (1, 2)]
    sizes = [size_s(late, CAMERA_LATE, "left", t) for t in (0.5, 1.0, 2.5, 3.0)]
    assert sizes == pytest.approx([0.0, 0.1, 0.2, 0.0])
    assert size_s(late, CAMERA_LATE, "right", 2.5) == 0.0


def test_the_receivers_clock_steps_and_it_falls_silent(tmp_path: Path) -> None:
    model = ReceiverModel(sigma_m=(0.0, 0.0, 0.0), gone_s=((8.0, 9.0),), stepped_s=((10.0, 11.0, 2.5),))
    flight = GlideApproach(start_y_m=300.0, end_y_m=100.0)
    receiver = SimulatedReceiver(tmp_path / "dgps", model, flight, lambda: 0.0, seed=1)
    utc_s = 1_750_000_000.0

    def reported(t_s: float, off_s: float) -> bytes:
        place = flight.position(np.array([t_s]))[0]
        return sentences(utc_s + off_s, place, SIMULATED_ORIGIN, model.sigma_m)

    assert receiver._reported(7.9, utc_s) == reported(7.9, 0.0)
    assert receiver._reported(8.5, utc_s) == b""
    assert receiver._reported(10.5, utc_s) == reported(10.5, 2.5)
    assert receiver._reported(11.0, utc_s) == reported(11.0, 0.0)


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (TimedFault(what=CAMERA_LOST, station="middle", from_s=0, to_s=1), "got 'middle'; wanted one of left, right"),
        (TimedFault(what=PTU_SILENT, station="right", from_s=0, to_s=1), "got 'right', which is fixed; wanted one"),
    ],
)
def test_a_device_that_is_not_there_is_refused(fault: TimedFault, words: str) -> None:
    rig = make_rig()
    rig = Rig(stations=(rig["left"], replace(rig["right"], fixed=True)))
    with pytest.raises(InputError, match=words):
        check_timetable((fault,), rig)


def test_a_mistake_ends_it_before_anything_is_begun(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, out = tmp_path / "faults.toml", tmp_path / "out"
    for text, words in (
        ('[[fault]]\nwhat = "dgps_gap"\nfrom_s = 1\n', "got dgps_gap without --dgps; wanted both"),
        (
            '[[fault]]\nwhat = "camera_lost"\nstation = "centre"\nfrom_s = 1\n',
            "got 'centre'; wanted one of left, right",
        ),
    ):
        path.write_text(text)
        assert main(["live", "--simulate", "--out", str(out), "--faults", str(path)]) == 1
        assert words in capsys.readouterr().err
        assert not out.exists(), words
