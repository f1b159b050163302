"""One draw of a target out of view: its error and its squares for each axis; medians of edges; no recording."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from groundstation.errors import InputError
from groundstation.experiments import onboard_edges, reproduce
from groundstation.experiments.leaving_view import _Realisation


class Filter:
    """A filter that an update brings nearer to the truth."""

    def __init__(self) -> None:
        self.layout = SimpleNamespace(position=slice(0, 3))
        self.state = np.array([1.0, 2.0, 3.0, 9.0])
        self.covariance = np.diag([1.0, 4.0, 9.0, 1.0])

    def update_pixel(self, station: str, pixel_px: np.ndarray, covariance_px2: np.ndarray) -> None:
        self.state = 0.5 * self.state


def seen(mass: float) -> _Realisation:
    draw = _Realisation.__new__(_Realisation)
    draw._ekf, draw._station, draw._truth_m = Filter(), "left", np.array([0.5, 0.0, 0.0])
    draw.mass, draw.detected = mass, np.zeros(2)
    return draw


@pytest.mark.parametrize(("mass", "error"), [(0.5, [0.0, 1.0, 1.5]), (0.1, [0.5, 2.0, 3.0])])
def test_the_error_is_estimate_less_truth_and_its_squares_are_per_axis(mass: float, error: list[float]) -> None:
    draw = seen(mass).correct(0.3)
    np.testing.assert_allclose(draw.error_m, error)
    assert draw.nees == pytest.approx(float(np.mean(np.square(error) / [1.0, 4.0, 9.0])))


def test_without_the_bundled_recording_one_has_to_be_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reproduce, "BUNDLED", tmp_path / "none")
    request = SimpleNamespace(only=["canny"], session=None, take_off=None, from_s=None, to_s=None, out=tmp_path)
    with pytest.raises(InputError, match="got no bundled recording; wanted one, or --session"):
        reproduce.reproduce(request)


def test_edges_are_reported_with_root_mean_square_and_median(monkeypatch: pytest.MonkeyPatch) -> None:
    own = np.array([[0.0, 1.0, -1.0, 30.0]])

    def track(sequence: object, count: int) -> onboard_edges._Tracked:
        found = {"ours": [None, object()]}
        return onboard_edges._Tracked(sequence=sequence, frames=[], errors={"ours": own}, found=found)

    monkeypatch.setattr(onboard_edges, "_track", track)
    monkeypatch.setattr(onboard_edges, "_rms_and_spread", lambda errors: [])
    findings = onboard_edges.edges(SimpleNamespace(at_most_s=lambda seconds: seconds))
    (numbers,) = [table for table in findings.tables if table.name == "runway_edges_numbers"]
    assert len(numbers.rows) == 4
    for row in numbers.rows:
        assert row[1:] == ["ours", pytest.approx(np.sqrt(902.0 / 4.0)), 1.0, 1]
