"""Two recordings of other renderers and the worlds that were built from what they show: hit shares and pictures.

    python benchmarks/rebuilt_recordings.py [--out DIR] [--draws N] [NAME …]

Each world of benchmarks/worlds is rendered and replayed N times, each time with other noise, encoder errors and lags of
the heads; so is the recording of that name, once, where $GROUNDSTATION_DATA has it. A recording is one draw; what is
compared with it is the mean of N. A frame is hit by a pixel that is at most 6 px outside the box around the silhouette,
by the rule that was used when the recordings were first looked at; the bank's own stricter rule stands next to it. DIR
has the sessions, and for each recording a picture: the recording left, the rebuilt one right, at equal times of flight,
the aircraft enlarged.
"""

import argparse
import os
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from groundstation.arrays import ImageArray
from groundstation.bank.frame_outcomes import FrameOutcome, frame_outcomes
from groundstation.bank.session_truth import SessionTruth
from groundstation.errors import SessionError
from groundstation.replay.replay import ReplayRequest, replay
from groundstation.session import load_session
from groundstation.simulation.world.render_world import render_world
from groundstation.simulation.world.world_file import load_world
from groundstation.sources.true_silhouettes import TrueSilhouette

ROOT = Path(__file__).resolve().parent.parent
WORLDS = ROOT / "benchmarks" / "worlds"
DATA = Path(os.environ.get("GROUNDSTATION_DATA", ROOT.parent / "shared" / "data"))
NAMES = ("landing-clutter", "takeoff-away")
BOX_MARGIN_PX = 6.0
_SHOWN = 6
_SEEDS_APART = 100
_TILE_PX = (480, 360)
# frames with the aircraft, shares hit and wrong by the box, share hit by the bank's rule
Shares = tuple[int, float, float, float]


def outside_box_px(silhouette: TrueSilhouette, pixel_px: np.ndarray) -> float:
    """Return how far a pixel (2,) is outside the box around a silhouette, px; 0 within it."""
    rows, columns = np.nonzero(silhouette.mask)
    low = np.array([silhouette.x + columns.min(), silhouette.y + rows.min()])
    high = np.array([silhouette.x + columns.max(), silhouette.y + rows.max()])
    return float(np.hypot(*np.maximum(np.maximum(low - pixel_px, pixel_px - high), 0.0)))


def shares(truth: SessionTruth, outcomes: Sequence[FrameOutcome]) -> dict[str, Shares]:
    """Return the shares by station."""
    found = {}
    for station in truth.session.rig.names:
        own = [o for o in outcomes if o.station == station and o.present]
        off = []
        for outcome in own:
            frame = truth.frame(station, outcome.pair)
            known = outcome.pixel_px is not None and frame is not None
            off.append(outside_box_px(frame.silhouette, outcome.pixel_px) if known else np.nan)  # type: ignore[union-attr, arg-type]
        distances = np.array(off)
        hit, wrong = distances < BOX_MARGIN_PX, distances >= BOX_MARGIN_PX
        strict = np.array([o.hit for o in own])
        found[station] = (len(own), float(hit.mean()), float(wrong.mean()), float(strict.mean()))
    return found


def replayed(folder: Path, out: Path) -> dict[str, Shares]:
    """Replay a session and return its shares."""
    shutil.rmtree(out, ignore_errors=True)
    result = replay(ReplayRequest(session=folder, out=out, rerun=False, report=False))
    if result.fault is not None:
        raise SessionError(folder.name, got=str(result.fault), wanted="a session that is replayed to its end")
    truth = SessionTruth(load_session(folder))
    return shares(truth, frame_outcomes(truth, result.evaluation))


def rendered(name: str, draw: int, out: Path) -> Path:
    """Render a world and return its session's folder; draw 0 is the file's own seed."""
    folder = out / f"{name}-rebuilt-{draw}"
    shutil.rmtree(folder, ignore_errors=True)
    world = load_world(WORLDS / f"{name}.toml")
    render_world(replace(world, seed=world.seed + _SEEDS_APART * draw), folder)
    return folder


def pictures(folder: Path, station: str, pairs: Sequence[int]) -> dict[int, ImageArray]:
    """Return these pairs' pictures of a station's video."""
    video = cv2.VideoCapture(str(folder / f"{station}.mp4"))
    found: dict[int, ImageArray] = {}
    for pair in range(max(pairs) + 1):
        good, picture = video.read()
        if not good:
            break
        if pair in pairs:
            found[pair] = np.asarray(picture, np.uint8)
    video.release()
    return found


def tiles(folder: Path, station: str, pairs: Sequence[int]) -> list[ImageArray]:
    """Return for each pair the whole picture and the aircraft enlarged, side by side; black where it is not there."""
    truth, shown, found = SessionTruth(load_session(folder)), pictures(folder, station, pairs), []
    for pair in pairs:
        w, h = _TILE_PX
        tile, frame = np.zeros((h, w + h, 3), np.uint8), truth.frame(station, pair)
        if pair in shown:
            tile[:, :w] = cv2.resize(shown[pair], (w, h), interpolation=cv2.INTER_AREA)
        if pair in shown and frame is not None:
            half = max(24, int(0.7 * frame.silhouette.width_px))
            u, v = np.rint(frame.silhouette.centre_px).astype(int)
            room = cv2.copyMakeBorder(shown[pair], half, half, half, half, cv2.BORDER_REPLICATE)
            near = room[v : v + 2 * half, u : u + 2 * half]
            tile[:, w:] = cv2.resize(near, (h, h), interpolation=cv2.INTER_NEAREST)
        found.append(tile)
    return found


def sheet(folders: Mapping[str, Path], path: Path) -> None:
    """Write a picture of both sessions at equal times of flight."""
    count = min(SessionTruth(load_session(folder)).pairs for folder in folders.values())
    pairs = [int(pair) for pair in np.linspace(2, count - 3, _SHOWN)]
    columns = [np.vstack(tiles(folder, "left", pairs)) for folder in folders.values()]
    cv2.imwrite(str(path), np.hstack(columns))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(NAMES)}; default: all")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "rebuilt")
    parser.add_argument("--draws", type=int, default=3, metavar="N", help="default: 3")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    print(f"{'session':28}{'station':>9}{'frames':>8}{'hit':>8}{'wrong':>8}{'hit, bank':>11}")
    for name in arguments.names or NAMES:
        if (DATA / name).is_dir():
            show(f"{name}, recording", replayed(DATA / name, arguments.out / f"{name}-result"))
        draws = []
        for draw in range(arguments.draws):
            folder = rendered(name, draw, arguments.out)
            draws.append(replayed(folder, arguments.out / f"{name}-rebuilt-{draw}-result"))
            show(f"{name}, rebuilt, {draw}", draws[-1])
        show(f"{name}, rebuilt, mean", mean_of(draws))
        folders = {"recording": DATA / name, "rebuilt": arguments.out / f"{name}-rebuilt-0"}
        sheet({kind: folder for kind, folder in folders.items() if folder.is_dir()}, arguments.out / f"{name}.png")


def mean_of(draws: Sequence[Mapping[str, Shares]]) -> dict[str, Shares]:
    """Return each station's means over the draws."""
    found = {}
    for station in draws[0]:
        frames, *rows = np.mean([draw[station] for draw in draws], axis=0).tolist()
        found[station] = (round(frames), rows[0], rows[1], rows[2])
    return found


def show(words: str, rows: Mapping[str, Shares]) -> None:
    """Print the shares of a session's stations."""
    for station, row in rows.items():
        print(f"{words:28}{station:>9}{row[0]:8d}{row[1]:8.3f}{row[2]:8.3f}{row[3]:11.3f}", flush=True)


if __name__ == "__main__":
    main()
