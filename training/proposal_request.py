"""One training run of the proposal network: pictures, fit, weights and their card."""

import hashlib
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

from groundstation.errors import InputError
from training.filmed_pictures import (
    FilmedPicture,
    PictureRequest,
    clip_pictures,
    load_pictures,
    make_pictures,
    save_pictures,
)
from training.network import parameters_of
from training.proposal_fit import ProposalSettings, fit_proposals
from training.proposal_network import export_proposals, load_proposals

WEIGHTS, CARD, PICTURES, REQUEST = "proposals.onnx", "card.json", "pictures.npz", "pictures.json"


@dataclass(frozen=True, slots=True, kw_only=True)
class ProposalRequest:
    """What is trained, from what.

    Attributes
    ----------
    out : folder of the run.
    pictures : which worlds are filmed.
    clips : folder of the real clips, mixed in; None for none.
    start : weights to begin with; None begins with random ones.
    fit : length, rate and seed.
    workers : processes that film and draw; the result does not depend on it.
    """

    out: Path
    pictures: PictureRequest
    clips: Path | None = None
    start: Path | None = None
    fit: ProposalSettings
    workers: int = 1


def train_proposals(request: ProposalRequest, progress: Callable[[str, int, int], None]) -> tuple[Path, Path, str]:
    """Film the pictures, or read them; train; return the paths of weights and card, and the weights' SHA-256.

    Raises `InputError` where the folder holds another run, or clips or weights are not as wanted.
    """
    start = None if request.start is None else load_proposals(request.start)
    started_with = None if request.start is None else hashlib.sha256(request.start.read_bytes()).hexdigest()
    pictures = _pictures(request, progress)
    clips = [] if request.clips is None else clip_pictures(request.clips)
    network = fit_proposals(
        pictures,
        clips,
        request.fit,
        request.out,
        lambda done, total: progress("steps", done, total),
        start=start,
        workers=request.workers,
    )
    weights, card = request.out / WEIGHTS, request.out / CARD
    sha256 = export_proposals(network, weights)
    noted = {
        "parameters": parameters_of(network),
        "crops": request.fit.steps * request.fit.batch,
        "fit": asdict(request.fit),
        "train_worlds": asdict(request.pictures),
        "filmed_pictures": len(pictures),
        "aircraft": sum(len(picture.aircraft) for picture in pictures),
        "birds": sum(len(picture.birds) for picture in pictures),
        "frames_of_real_clips": len(clips),
        "started_with": started_with,
        "sha256": sha256,
    }
    card.write_text(json.dumps(noted, indent=1) + "\n", encoding="utf-8")
    return weights, card, sha256


def _pictures(request: ProposalRequest, progress: Callable[[str, int, int], None]) -> list[FilmedPicture]:
    path, noted = request.out / PICTURES, request.out / REQUEST
    words = json.dumps(asdict(request.pictures))
    if noted.exists():
        if noted.read_text(encoding="utf-8") != words:
            raise InputError(str(path), got="pictures of another request", wanted=f"those of {words}, or no folder")
        return load_pictures(path)
    pictures = make_pictures(
        request.pictures, lambda done, total: progress("worlds", done, total), workers=request.workers
    )
    save_pictures(pictures, path)
    noted.write_text(words, encoding="utf-8")
    return pictures
