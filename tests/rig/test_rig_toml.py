"""A rig written and read again is the same rig."""

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from groundstation.rig.covariance import ParameterCovariance
from groundstation.rig.rig import ClockModel, Rig, Station, load_rig
from groundstation.rig.rig_toml import rig_to_toml
from groundstation.simulation import StationErrors, perturbed, standard_rig


def assert_same(a: Station, b: Station) -> None:
    for item in fields(Station):
        if item.name == "lens":
            assert a.lens.image_size_px == b.lens.image_size_px
            for name in ("focal_px", "principal_point_px", "distortion"):
                assert np.array_equal(getattr(a.lens, name), getattr(b.lens, name)), name
        elif isinstance(getattr(a, item.name), np.ndarray):
            assert getattr(a, item.name) == pytest.approx(getattr(b, item.name), abs=1e-15), item.name
        elif isinstance(getattr(a, item.name), float):
            assert getattr(a, item.name) == pytest.approx(getattr(b, item.name), rel=1e-13), item.name
        elif item.name != "ptu_clock_given":
            assert getattr(a, item.name) == getattr(b, item.name), item.name


def rewritten(rig: Rig, folder: Path) -> Rig:
    path = folder / "rig.toml"
    path.write_text(rig_to_toml(rig))
    return load_rig(path)


def test_a_whole_rig(tmp_path: Path) -> None:
    errors = StationErrors(
        mount_rad=np.array([1e-3, 2e-3, 3e-3]),
        boresight_rad=np.array([1e-3, 0, 0]),
        camera_offset_s=0.1,
        ptu_drift_ppm=3.0,
    )
    rig = perturbed(standard_rig(third=True), {"left": errors})
    covariance = np.array([[1e-8, 1e-9], [1e-9, 1e-4]])
    right = replace(
        rig["right"],
        covariance_parameters=("runway_from_base.z", "ptu_position.x"),
        covariance=covariance,
        readout_s=0.02,
        ptu_clock=ClockModel(offset_s=0.1, drift_ppm=2.0, sigma_s=0.01),
    )
    shared = ParameterCovariance(names=("left.ptu_position.y", "right.ptu_position.y"), matrix=1e-4 * np.ones((2, 2)))
    rig = replace(rig, stations=(rig["left"], right, replace(rig["third"], fixed=True)), shared_covariance=shared)
    again = rewritten(rig, tmp_path)
    assert again.shared_covariance.names == shared.names
    np.testing.assert_array_equal(again.shared_covariance.matrix, shared.matrix)
    assert again.names == rig.names
    for a, b in zip(rig.stations, again.stations, strict=True):
        assert_same(a, b)


def test_what_is_not_known_is_left_out(tmp_path: Path) -> None:
    rig = standard_rig()
    rig = replace(rig, stations=(replace(rig["left"], known=("position", "lens")), rig["right"]))
    again = rewritten(rig, tmp_path)
    assert again["left"].known == ("position", "lens")
    assert again["left"].runway_from_base_wxyz == pytest.approx([1, 0, 0, 0])
    assert "wxyz" not in rig_to_toml(replace(rig, stations=rig.stations[:1]))


def test_the_bundled_rig(landing_1: Path, tmp_path: Path) -> None:
    rig = load_rig(landing_1 / "rig.toml")
    for a, b in zip(rig.stations, rewritten(rig, tmp_path).stations, strict=True):
        assert_same(a, b)
