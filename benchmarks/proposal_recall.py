"""Share of the aircraft in pictures of worlds that are among the first proposals, and the time of a search.

    python benchmarks/proposal_recall.py --out DIR [--first N] [--worlds N] [--pictures N] [--weights FILE]

Pictures of train worlds are filmed once for a folder (500 to 539 were never trained on). A proposal counts where its
middle is within 0.35 of the aircraft's width, or 5 px, of the middle of its box, each way, and its width is between
half and twice as large. Aircraft that are hidden or too faint are left out; those of the traffic count as well. The
classic finder is given the same pictures, one by one, without motion. Times are the processor's, of a whole picture.
"""

import argparse
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path

import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.detection.candidate_finder import AcquisitionConfig, CandidateFinder
from groundstation.detection.proposal_finder import ProposalFinder
from groundstation.files.channel_weights import proposal_weights, read_weights
from training.filmed_pictures import FilmedPicture, PictureRequest, load_pictures, make_pictures, save_pictures

RANKS = (1, 3, 6, 12, 24)
LIMITS_PX = (8.0, 16.0, 32.0, 128.0, np.inf)
NEAR_SHARE, NEAR_PX, WIDER = 0.35, 5.0, 2.0
LEAST_WIDTH_PX = LIMITS_PX[0]
# place x, y, width, px
Place = tuple[float, float, float]


def rank_of(places: list[Place], box: FloatArray) -> int:
    """Return which of the places shows the aircraft in a box x0, y0, x1, y1, from 0; as many as there are for none."""
    width, middle = box[2] - box[0], 0.5 * (box[:2] + box[2:]) - 0.5
    near = max(NEAR_SHARE * width, NEAR_PX)
    for k, (u, v, wide) in enumerate(places):
        if abs(u - middle[0]) < near and abs(v - middle[1]) < near and 1.0 / WIDER < wide / width < WIDER:
            return k
    return RANKS[-1]


def by_network(weights: bytes) -> Callable[[ImageArray], list[Place]]:
    """Return the proposals of the network."""

    def find(image: ImageArray) -> list[Place]:
        finder = ProposalFinder(weights, (image.shape[1], image.shape[0]))
        found = finder.proposals(image, range(finder.count), RANKS[-1])
        return [(float(p.centre_px[0]), float(p.centre_px[1]), p.width_px) for p in found]

    return find


def by_contrast(image: ImageArray) -> list[Place]:
    """Return the candidates of the classic finder."""
    config = AcquisitionConfig(max_candidates=RANKS[-1])
    found = CandidateFinder(config, (image.shape[1], image.shape[0])).find(image, 0.0)
    return [(0.5 * (c.box.x0 + c.box.x1) - 0.5, 0.5 * (c.box.y0 + c.box.y1) - 0.5, c.box.w) for c in found]


def print_recall(name: str, find: Callable[[ImageArray], list[Place]], pictures: list[FilmedPicture]) -> None:
    """Print a method's table."""
    ranks: dict[str, list[int]] = defaultdict(list)
    times_s = []
    for picture in pictures:
        image = picture.image()
        began_s = time.process_time()
        places = find(image)
        times_s.append(time.process_time() - began_s)
        for box in picture.aircraft:
            width = float(box[2] - box[0])
            if width < LEAST_WIDTH_PX:
                continue
            high = next(limit for limit in LIMITS_PX[1:] if width < limit)
            low = LIMITS_PX[LIMITS_PX.index(high) - 1]
            for kind in (f"{low:3.0f} to {high:3.0f} px", "all"):
                ranks[kind].append(rank_of(places, box))
    median, late = 1e3 * np.median(times_s), 1e3 * np.quantile(times_s, 0.99)
    print(f"{name}: {median:.0f} ms a picture ({late:.0f} at 99 %)")
    for kind, found in sorted(ranks.items()):
        shares = "  ".join(f"@{n} {100.0 * np.mean(np.array(found) < n):5.1f}" for n in RANKS)
        print(f"  {kind:14} {len(found):5d}  {shares}")


def main() -> None:
    """Film, or read, the pictures; print both tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder of the pictures")
    parser.add_argument("--first", type=int, default=500)
    parser.add_argument("--worlds", type=int, default=40)
    parser.add_argument("--pictures", type=int, default=12)
    parser.add_argument("--weights", type=Path)
    options = parser.parse_args()
    path = options.out / f"pictures-{options.first}-{options.worlds}-{options.pictures}.npz"
    if not path.exists():
        request = PictureRequest(first=options.first, worlds=options.worlds, pictures=options.pictures)
        save_pictures(make_pictures(request), path)
    pictures = load_pictures(path)
    weights = proposal_weights() if options.weights is None else read_weights(options.weights, None)
    print_recall("proposal network", by_network(weights), pictures)
    print_recall("classic finder", by_contrast, pictures)


if __name__ == "__main__":
    main()
