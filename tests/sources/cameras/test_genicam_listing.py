"""Producers that fail while cameras are listed: one line, and what was shared is given back."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from groundstation.sources.cameras import genicam_producer
from groundstation.sources.cameras.camera import CameraError
from groundstation.sources.cameras.genicam_producer import list_genicam


class ProducerError(Exception):
    """What a producer raises."""


@pytest.mark.parametrize("fails", [True, False])
def test_a_producers_fault_is_one_line(fails: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    given_back: list[tuple[Path, ...]] = []

    def refresh(harvester: object) -> None:
        if fails:
            raise ProducerError("no transport\nlayer")

    monkeypatch.setattr(genicam_producer, "load_harvesters", lambda name: (None, SimpleNamespace()))
    monkeypatch.setattr(genicam_producer, "_share", lambda producers: object())
    monkeypatch.setattr(genicam_producer, "_unshare", given_back.append)
    monkeypatch.setattr(genicam_producer, "_faults", lambda gentl: (ProducerError,))
    monkeypatch.setattr(genicam_producer, "_refresh", refresh)
    monkeypatch.setattr(genicam_producer, "device_infos", lambda harvester: ["camera"])
    producers = (Path("some.cti"),)
    if fails:
        with pytest.raises(CameraError, match="genicam: got no transport layer; wanted a list of cameras"):
            list_genicam(producers)
    else:
        assert list_genicam(producers) == ["camera"]
    assert given_back == [producers]
