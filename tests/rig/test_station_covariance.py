"""What is known of a station's calibration is the same in whichever table of the rig it stands."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calibration.flight.parameters import choose_parameters
from calibration.lens.lens_files import read_lens
from calibration.mount.parameters import choose_mount
from groundstation.rig.covariance import ParameterCovariance
from groundstation.rig.rig import Rig
from groundstation.rig.rig_toml import rig_to_toml
from tests.architecture.sources import ROOT, WITH_BENCHMARKS, modules, nodes_of
from tests.stereo_rig import make_rig

NAMES = ("runway_from_base.z", "head_from_camera.x", "focal.x", "ptu_position.y")
SIGMAS = np.array([2e-4, 1e-4, 3.0, 0.01])
CORRELATION = np.eye(4) + 0.3 * (np.ones((4, 4)) - np.eye(4))
MATRIX = CORRELATION * np.outer(SIGMAS, SIGMAS)
# they write the tables of a rig
WRITERS = {
    "groundstation.rig.rig",
    "groundstation.rig.rig_toml",
    "calibration.flight.rig",
    "calibration.lens.rig",
    "calibration.mount.parameters",
    # it draws stations that it makes itself
    "benchmarks.drawn_rigs",
}


def own() -> Rig:
    rig = make_rig()
    return replace(
        rig, stations=tuple(replace(s, covariance_parameters=NAMES, covariance=MATRIX) for s in rig.stations)
    )


def together() -> Rig:
    """Return it with both stations' parameters in the rig's table, the positions' errors in common, and a clock."""
    rig, stated = make_rig(), own().calibration_covariance()
    names = (*stated.names, "left.ptu_clock.offset")
    matrix = np.zeros((len(names), len(names)))
    matrix[:-1, :-1] = stated.matrix
    matrix[-1, -1] = 1e-4
    i, j = (names.index(f"{name}.ptu_position.y") for name in rig.names)
    matrix[i, j] = matrix[j, i] = 0.5 * SIGMAS[3] ** 2
    return replace(rig, shared_covariance=ParameterCovariance(names=names, matrix=matrix))


def divided() -> Rig:
    """Return it with one parameter in the rig's table only, and another in both."""
    rig = own()
    rest = [0, 2, 3]
    stations = tuple(
        replace(s, covariance_parameters=tuple(NAMES[k] for k in rest), covariance=MATRIX[np.ix_(rest, rest)])
        for s in rig.stations
    )
    both = [1, 0]
    names = tuple(f"{station}.{NAMES[k]}" for station in rig.names for k in both)
    matrix = np.kron(np.eye(2), MATRIX[np.ix_(both, both)])
    return replace(rig, stations=stations, shared_covariance=ParameterCovariance(names=names, matrix=matrix))


RIGS = pytest.mark.parametrize("make", [own, together, divided])


@RIGS
def test_a_station_s_covariance_is_the_marginal(make: Callable[[], Rig]) -> None:
    rig = make()
    for name in rig.names:
        known = rig.station_covariance(name)
        assert set(known.names) == set(NAMES)
        order = [known.names.index(n) for n in NAMES]
        np.testing.assert_array_equal(np.diag(known.matrix)[order], np.diag(MATRIX))
        assert known.sigmas == pytest.approx(dict(zip(NAMES, SIGMAS, strict=True)))
    if make is not divided:
        np.testing.assert_array_equal(known.matrix[np.ix_(order, order)], MATRIX)


@RIGS
def test_the_priors_are_those_of_the_rig(make: Callable[[], Rig]) -> None:
    rig = make()
    free = choose_parameters(rig, ("orientation", "boresight", "lens", "position"), dgps_clock_open=False)
    flight = dict(zip(free.names, free.prior_sigma, strict=True))
    mount = choose_mount(rig["left"], rig.station_covariance("left"), (), ("boresight",))
    for name, sigma in zip(NAMES, SIGMAS, strict=True):
        assert flight[f"left.{name}"] == pytest.approx(sigma)
    assert mount["head_from_camera.x"] == pytest.approx(SIGMAS[1])


@RIGS
def test_a_lens_is_read_with_its_covariance(make: Callable[[], Rig], tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(rig_to_toml(make()))
    assert read_lens(path, "right").covariance[0, 0] == pytest.approx(SIGMAS[2] ** 2)


def readers() -> set[str]:
    """Return the modules that read a station's own table; without its names its matrix is of no use."""
    return {
        name
        for name, path in modules(WITH_BENCHMARKS).items()
        if any(getattr(node, "attr", "") == "covariance_parameters" for node in nodes_of(path))
    }


def test_only_writers_of_rigs_read_a_station_s_own_table() -> None:
    """Expected: every other module asks `Rig.station_covariance`, which knows both tables."""
    found = readers()
    assert found == WRITERS, f"in {ROOT}: {sorted(found ^ WRITERS)}"
