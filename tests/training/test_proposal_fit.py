"""Fitting the proposal network: it learns, goes on where it was interrupted, and is the same read back from ONNX."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch", reason="extra train is not installed")
pytest.importorskip("onnx", reason="extra train is not installed")

import torch

from groundstation.detection.proposal_finder import ProposalFinder
from groundstation.errors import InputError
from tests.training.test_proposal_crops import picture
from training.filmed_pictures import FilmedPicture
from training.proposal_fit import ProposalSettings, crop_batches, fit_proposals
from training.proposal_network import ProposalNetwork, export_proposals, load_proposals

SETTINGS = ProposalSettings(steps=4, batch=16, every=2)
PICTURES = [
    picture([[300.0, 200.0, 360.0, 224.0]]),
    picture([[100.0, 300.0, 130.0, 312.0]], [[50.0, 60.0, 70.0, 70.0]]),
]


def _same(one: ProposalNetwork, other: ProposalNetwork) -> bool:
    pairs = zip(one.state_dict().values(), other.state_dict().values(), strict=True)
    return all(bool(torch.equal(first, second)) for first, second in pairs)


def test_crops_are_the_same_with_any_number_of_processes() -> None:
    for one, two in zip(
        crop_batches(PICTURES, (), SETTINGS, 1, 0), crop_batches(PICTURES, (), SETTINGS, 1, 2), strict=True
    ):
        assert all(torch.equal(a, b) for a, b in zip(one, two, strict=True))


def test_an_interrupted_run_ends_as_one_that_was_not(tmp_path: Path) -> None:
    class StoppedError(Exception):
        pass

    def stop(done: int, total: int) -> None:
        if done == 2:
            raise StoppedError

    with pytest.raises(StoppedError):
        fit_proposals(PICTURES, (), SETTINGS, tmp_path / "a", stop)
    again = fit_proposals(PICTURES, (), SETTINGS, tmp_path / "a")
    whole = fit_proposals(PICTURES, (), SETTINGS, tmp_path / "b")
    assert _same(again, whole)
    assert (tmp_path / "a" / "log.csv").read_text() == (tmp_path / "b" / "log.csv").read_text()
    with pytest.raises(InputError, match="an empty folder"):
        fit_proposals(PICTURES, (), replace(SETTINGS, seed=2), tmp_path / "a")
    with pytest.raises(InputError, match="other pictures"):
        fit_proposals(PICTURES[:1], (), SETTINGS, tmp_path / "a")


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_it_learns_where_aircraft_are(tmp_path: Path) -> None:
    """Expected: after some seconds the middle of a dark box comes first, in the program as it runs."""
    fitted = fit_proposals(PICTURES, (), replace(SETTINGS, steps=60, batch=32), tmp_path)
    path = tmp_path / "proposals.onnx"
    export_proposals(fitted, path)
    read = load_proposals(path).state_dict()
    for name, value in fitted.cpu().state_dict().items():
        # how many batches a norm has seen is in no file
        assert name.endswith("num_batches_tracked") or torch.equal(value, read[name])
    finder = ProposalFinder(path.read_bytes(), (640, 480))
    first = finder.proposals(PICTURES[0].image(), range(finder.count), 4)[0]
    assert np.hypot(*(first.centre_px - [329.5, 211.5])) < 20.0
    with pytest.raises(InputError, match="weights of the proposal network"):
        load_proposals(_other_file(tmp_path))


def test_settings_and_pictures_that_cannot_be(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="a multiple of 8"):
        ProposalSettings(batch=12)
    none: list[FilmedPicture] = []
    with pytest.raises(InputError, match="some to learn from"):
        fit_proposals(none, none, SETTINGS, tmp_path)


def _other_file(folder: Path) -> Path:
    path = folder / "other.onnx"
    path.write_bytes(b"no network")
    return path
