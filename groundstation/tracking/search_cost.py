"""How long this machine takes to search one picture of each camera, now and next to what else runs on it."""

from collections.abc import Callable, Iterable
from itertools import pairwise
from statistics import median

import numpy as np

from groundstation.detection.candidate_finder import AcquisitionConfig
from groundstation.detection.config import DetectionConfig, DetectorKind
from groundstation.detection.make_detector import make_finder
from groundstation.geometry.camera import Lens
from groundstation.tracking.warm_up import warm_up

_ROUNDS = 8
_APART_S = 0.2
_PATCH_PX = 16


def search_pair_s(lenses: Iterable[Lens], stopwatch: Callable[[], float], kind: DetectorKind) -> float:
    """Return the time in s to search one picture of each lens, the median of several rounds."""
    warm_up(kind)
    rng = np.random.default_rng(1)
    searches = []
    for lens in lenses:
        w, h = lens.image_size_px
        coarse = rng.integers(90, 170, (h // _PATCH_PX + 1, w // _PATCH_PX + 1, 3), dtype=np.uint8)
        scene = np.ascontiguousarray(np.kron(coarse, np.ones((_PATCH_PX, _PATCH_PX, 1), np.uint8))[:h, :w])
        searches.append((make_finder(AcquisitionConfig(), DetectionConfig(detector=kind), lens), scene))
    at_s = [stopwatch()]
    for k in range(_ROUNDS):
        for finder, scene in searches:
            finder.find(scene, _APART_S * k, np.eye(3))
        at_s.append(stopwatch())
    return median(after - before for before, after in pairwise(at_s))
