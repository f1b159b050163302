from dataclasses import replace
from pathlib import Path

import pytest

from groundstation.errors import RigError
from groundstation.replay.replay_inputs import load_inputs
from groundstation.replay.replay_request import ReplayRequest
from groundstation.rig.rig import Rig
from groundstation.rig.stations_apart import require_one_sight
from tests.session.folder import Tiny, replace_in
from tests.stereo_rig import BASELINE_M, FOCAL_PX, make_rig


def scaled(factor: float, names: tuple[str, ...] = ("left", "right")) -> Rig:
    rig = make_rig(names)
    stations = (replace(s, ptu_position_m=factor * s.ptu_position_m) for s in rig.stations)
    return replace(rig, stations=tuple(stations))


def test_a_rig_in_millimetres_is_named_before_a_picture_is_read() -> None:
    """Expected: two ranges that add up to 10 770 m are more than twice the 3834 m at which 2.3 m are 4 px wide."""
    with pytest.raises(RigError) as refused:
        require_one_sight(scaled(1000.0), 2.3)
    assert str(refused.value) == (
        "rig.toml: got stations that are 10770 m apart: is the rig in metres?; "
        "wanted two in whose pictures an aircraft of 2.3 m is 4 px wide or wider at once"
    )


def test_what_may_see_the_aircraft_is_left_alone() -> None:
    """Expected: metres, feet, no span, one station, an aircraft that is wide enough, two of three that stand close."""
    for factor in (1.0, 1.0 / 0.3048, 350.0):
        require_one_sight(scaled(factor), 2.3)
    require_one_sight(scaled(1000.0), None)
    require_one_sight(scaled(1000.0, ("left",)), 2.3)
    widest_m = 4.0 * 1000.0 * BASELINE_M / (2.0 * FOCAL_PX)
    require_one_sight(scaled(1000.0), 1.01 * widest_m)
    with pytest.raises(RigError, match="10770 m"):
        require_one_sight(scaled(1000.0), 0.99 * widest_m)
    near = make_rig(("left", "right", "third"))
    far = replace(near.stations[2], ptu_position_m=100_000.0 * near.stations[2].ptu_position_m)
    require_one_sight(replace(near, stations=(*near.stations[:2], far)), 2.3)


def test_what_another_detector_finds_may_have_no_outline(tmp_path: Path) -> None:
    """Expected: stations five kilometres apart are refused with pictures alone; a lamp's pixels need no span."""
    folder = Tiny(rows=3).write(tmp_path / "t")
    replace_in(folder / "rig.toml", "ptu_position_m = [-5.0", "ptu_position_m = [-5000.0")
    request = ReplayRequest(session=folder, out=tmp_path / "out")
    with pytest.raises(RigError, match="5000 m apart: is the rig in metres"):
        load_inputs(request)
    load_inputs(replace(request, detector=lambda *_: None))
    for path in folder.glob("*.avi"):
        path.unlink()
    (folder / "detections.csv").write_text("t_s,station,u_px,v_px\n1.0,left,30,20\n1.0,right,30,20\n")
    load_inputs(request)
