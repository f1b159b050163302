"""One training run: material, fit, weights and their card; it goes on where an earlier run into its folder ended."""

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from groundstation.errors import InputError
from training.export import export_onnx, load_onnx
from training.fit import FitSettings, fit
from training.labelled_pictures import labelled_pictures
from training.material import (
    Material,
    MaterialRequest,
    joined,
    load_material,
    make_material,
    save_material,
    without_kinds,
)
from training.network import ChannelNetwork, parameters_of
from training.recorded_windows import RecordedTarget, recorded_targets

WEIGHTS, CARD, MATERIAL, REQUEST = "aircraft.onnx", "card.json", "material", "request.json"


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainRequest:
    """What is trained, from what.

    Attributes
    ----------
    out : folder of the run.
    material : what windows are drawn from.
    further : folders of material that was made before, which is joined to it.
    recordings : session folders with true silhouettes whose windows are mixed in.
    pictures : folder of labelled pictures, mixed in, too.
    start : weights to begin with; None begins with random ones.
    fit : length, rate and seed.
    workers : processes that make the material and draw the windows; the result does not depend on it.
    """

    out: Path
    material: MaterialRequest
    further: tuple[Path, ...] = ()
    recordings: tuple[Path, ...] = ()
    pictures: Path | None = None
    start: Path | None = None
    fit: FitSettings
    workers: int = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Trained:
    """Where the weights and their card are, and the weights' SHA-256."""

    weights: Path
    card: Path
    sha256: str


def train(request: TrainRequest, progress: Callable[[str, int, int], None]) -> Trained:
    """Make the material, or read it; train; write the weights and their card.

    ``progress(what, done, total)`` is called along the way. Raises `InputError` where the folder holds another run, a
    recording has no truth, or pictures or weights are not as wanted.
    """
    start = None if request.start is None else load_onnx(request.start)
    # the run may overwrite the very file that it begins with
    started_with = None if request.start is None else hashlib.sha256(request.start.read_bytes()).hexdigest()
    pictures = [] if request.pictures is None else labelled_pictures(request.pictures)
    left_out = request.material.without
    further = [without_kinds(load_material(folder), left_out) for folder in request.further]
    material = joined([_material(request, progress), *further])
    recorded: list[RecordedTarget] = []
    for folder in request.recordings:
        recorded += recorded_targets(folder)
    fitted = fit(
        material,
        recorded,
        request.fit,
        request.out,
        lambda done, total: progress("fit", done, total),
        pictures=pictures,
        start=start,
        workers=request.workers if request.workers > 1 else 0,
    )
    weights = request.out / WEIGHTS
    sha256 = export_onnx(fitted.network, weights)
    for kind, network in fitted.without.items():
        export_onnx(network, request.out / f"without-{kind}.onnx")
    hashes = {"sha256": sha256, "started_with": started_with}
    card = request.out / CARD
    card.write_text(
        json.dumps(_card(request, material, recorded, pictures, fitted.network) | hashes, indent=1) + "\n",
        encoding="utf-8",
    )
    return Trained(weights=weights, card=card, sha256=sha256)


def material_of(request: TrainRequest, progress: Callable[[str, int, int], None]) -> Path:
    """Make the material of a request, unless it is there; return its folder."""
    _material(request, progress)
    return request.out / MATERIAL


def _material(request: TrainRequest, progress: Callable[[str, int, int], None]) -> Material:
    folder = request.out / MATERIAL
    mined = request.material.mined_with
    # the weights count, not where they are
    noted_with = {"mined_with": None if mined is None else hashlib.sha256(mined.read_bytes()).hexdigest()}
    words = json.dumps(asdict(request.material) | noted_with, default=str)
    noted = folder / REQUEST
    if noted.exists():
        if noted.read_text(encoding="utf-8") != words:
            raise InputError(str(folder), got="material of another request", wanted=f"that of {words}, or no folder")
        return load_material(folder)
    made = partial(progress, "material")
    material = make_material(request.material, made, workers=request.workers)
    save_material(material, folder)
    noted.write_text(words, encoding="utf-8")
    return material


def _requests(request: TrainRequest) -> list[dict[str, Any] | None]:
    """Return what each material was made by, as noted in its folder; None where a folder does not say."""
    folders = [request.out / MATERIAL, *request.further]
    return [
        json.loads((folder / REQUEST).read_text(encoding="utf-8")) if (folder / REQUEST).exists() else None
        for folder in folders
    ]


def _left_out(requests: Sequence[dict[str, Any] | None]) -> list[str]:
    """Return the kinds that no material has; none where one of them does not say."""
    kinds = ("without_families", "without_sceneries", "without_skies")
    said = [{word for kind in kinds for word in (each or {}).get(kind, ())} for each in requests]
    return sorted(set.intersection(*said))


def _card(
    request: TrainRequest,
    material: Material,
    recorded: list[RecordedTarget],
    pictures: list[RecordedTarget],
    network: ChannelNetwork,
) -> dict[str, object]:
    """Return what the weights were made from."""
    clips = sum(not background.drawn for background in material.backgrounds)
    requests = _requests(request)
    return {
        "parameters": parameters_of(network),
        "windows": request.fit.steps * request.fit.batch,
        "fit": asdict(request.fit),
        "train_worlds": [None if each is None else [each.get("first", 0), each["worlds"]] for each in requests],
        "mined_with": sorted({each["mined_with"] for each in requests if each and each.get("mined_with")}),
        "drawn_aircraft": len(material.aircraft),
        "drawn_birds": len(material.birds),
        "filmed_targets": len(material.filmed),
        "drawn_backgrounds": len(material.backgrounds) - clips,
        "frames_of_real_clips": clips,
        "recorded_targets": len(recorded),
        "recordings": [folder.name for folder in request.recordings],
        "labelled_pictures": len(pictures),
        "left_out": _left_out(requests),
    }
