"""The whole job on the rendered sessions of development, with exact truth: no information on the flight is given.

The learned channel was trained on these two sessions, too (docs/learned-channel.md): these bounds are tested, and do
not extend to other aircraft and skies. Stated sigmas are those of an aircraft not seen before, wider than needed here.
"""

import csv
import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest
from calibrated_replays import Split, by_pixels, replayed_as, splits, spoilt_rig, truth_rmse
from change_indicator import FIGURES, agrees, figures
from pages.kept_figures import kept, moved

from calibration.flight.calibrate import FlightRequest, calibrate_flight
from groundstation.replay.replay import ReplayRequest, replay
from groundstation.rig.rig import load_rig
from groundstation.rig.rig_toml import rig_to_toml
from tests.conftest import ROOT
from tests.seekable_landing import lossless_copy

pytestmark = pytest.mark.usefixtures("unrendered_figures")


@dataclass(frozen=True)
class Replayed:
    """One replay's files, read back as a user's scorer would."""

    folder: Path
    summary: dict
    track: list[dict[str, str]]
    truth: np.ndarray

    def errors(self, low_y_m: float, high_y_m: float, name: str = "track.csv") -> np.ndarray:
        """Errors (n, 3) against truth of the rows that have a position, in a range of y."""
        rows = [r for r in read(self.folder / name) if r["x_m"]]
        if name == "triangulation.csv":
            rows = [r for r in rows if r["status"] == "ok"]
        t = np.array([float(r["t_s"]) for r in rows])
        x = np.array([[float(r[k]) for k in ("x_m", "y_m", "z_m")] for r in rows])
        true = np.column_stack([np.interp(t, self.truth["t_s"], self.truth[k]) for k in ("x_m", "y_m", "z_m")])
        chosen = (true[:, 1] >= low_y_m) & (true[:, 1] < high_y_m)
        return (x - true)[chosen]

    def rmse(self, low_y_m: float, high_y_m: float, name: str = "track.csv") -> np.ndarray:
        return np.sqrt((self.errors(low_y_m, high_y_m, name) ** 2).mean(axis=0))


def read(path: Path) -> list[dict[str, str]]:
    with path.open() as stream:
        return list(csv.DictReader(stream))


def replayed(
    session: Path, out: Path, *, to_s: float | None = None, pages: bool = False, config: Path | None = None
) -> Replayed:
    """Replay a session; ``pages``: with its report and its Rerun recording, which have no part in the figures."""
    result = replay(ReplayRequest(session=session, out=out, to_s=to_s, rerun=pages, report=pages, config=config))
    assert result.fault is None
    return Replayed(
        folder=out,
        summary=json.loads((out / "summary.json").read_text()),
        track=read(out / "track.csv"),
        truth=np.genfromtxt(session / "truth.csv", delimiter=",", names=True),
    )


@pytest.fixture(scope="module")
def landing(landing_1: Path, tmp_path_factory: pytest.TempPathFactory) -> Replayed:
    return replayed(landing_1, tmp_path_factory.mktemp("landing"), pages=True)


@pytest.fixture(scope="module")
def takeoff_1(shared_data: Path) -> Path:
    """The take-off, which is decoded five times here, with the same pictures in another coding."""
    return lossless_copy(shared_data / "takeoff-1", ROOT / "build" / "seekable")


@pytest.fixture(scope="module")
def takeoff(takeoff_1: Path, tmp_path_factory: pytest.TempPathFactory) -> Replayed:
    return replayed(takeoff_1, tmp_path_factory.mktemp("takeoff"))


@pytest.fixture(scope="module")
def classic(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The classic detector, whose pixels of these two flights need no error of an unseen aircraft."""
    path = tmp_path_factory.mktemp("classic") / "classic.toml"
    path.write_text(
        '[detection]\ndetector = "classic"\n[estimation]\ntarget_point_sigma_spans = [0.0, 0.0, 0.0]\n'
        "target_point_behind_spans = 0.0\ntarget_point_behind_up_spans = 0.0\n"
    )
    return path


@pytest.fixture(scope="module")
def classic_landing(lossless_landing: Path, classic: Path, tmp_path_factory: pytest.TempPathFactory) -> Replayed:
    return replayed(lossless_landing, tmp_path_factory.mktemp("classic-landing"), config=classic)


@pytest.fixture(scope="module")
def classic_takeoff(takeoff_1: Path, classic: Path, tmp_path_factory: pytest.TempPathFactory) -> Replayed:
    return replayed(takeoff_1, tmp_path_factory.mktemp("classic-takeoff"), config=classic)


def test_landing_accuracy(landing: Replayed) -> None:
    """y 100–250 m: at most 0.035/0.45/0.04 m, and every one of its frames covered."""
    errors = landing.errors(100, 250)
    y_m = landing.truth["y_m"]
    assert len(errors) == ((y_m >= 100) & (y_m < 250)).sum() > 100
    assert np.all(landing.rmse(100, 250) <= [0.035, 0.45, 0.04])


def test_the_committed_figures(landing: Replayed) -> None:
    """The bundled landing gives the committed figures; only `make figures` updates them."""
    old, new = json.loads(FIGURES.read_text()), figures(landing.summary)
    moved = {
        name: (old.get(name), new.get(name))
        for name in {**old, **new}
        if name not in old or name not in new or not agrees(new[name], old[name])
    }
    assert not moved, f"committed and measured differ: {moved}; if that is meant, run `make figures` and say why"


def test_the_kept_figures_of_the_take_off(takeoff: Replayed) -> None:
    """The take-off gives the figures that the pages quote; `make pages` updates file and pages."""
    old, new = kept()["takeoff-1"], figures(takeoff.summary)
    found = {name: (old.get(name), new.get(name)) for name in moved(old, new)}
    assert not found, f"kept and measured differ: {found}; if that is meant, run `make pages` and say why"


def test_landing_filter_beats_triangulation_beyond_100_m(landing: Replayed) -> None:
    """In every axis, over all epochs beyond 100 m that have both; far out by a factor of two and more along y."""
    fixes = {r["t_s"] for r in read(landing.folder / "triangulation.csv") if r["status"] == "ok"}
    both = [r for r in landing.track if r["x_m"] and r["t_s"] in fixes]
    t = np.array([float(r["t_s"]) for r in both])
    assert np.isin(t, landing.truth["t_s"]).all()
    by_range = {g["from_m"]: g["common"] for g in landing.summary["accuracy"]["truth"]["by_range"]}
    ours = theirs = np.zeros(3)
    for start, group in by_range.items():
        if start >= 100:
            ours = ours + group["epochs"] * np.square(group["ekf_rmse_m"])
            theirs = theirs + group["epochs"] * np.square(group["triangulation_rmse_m"])
    assert np.all(ours < theirs)
    for start in (150, 250, 400):
        assert np.all(np.array(by_range[start]["ekf_rmse_m"]) < by_range[start]["triangulation_rmse_m"])
        assert 2 * by_range[start]["ekf_rmse_m"][1] < by_range[start]["triangulation_rmse_m"][1]


def test_landing_is_acquired_without_an_initial_state(landing: Replayed) -> None:
    """Within 3 s of the first frame, at 500 m, without a start."""
    first = next(r for r in landing.track if r["status"] == "tracking")
    assert float(first["t_s"]) < landing.truth["t_s"][0] + 3.0
    assert abs(float(first["y_m"]) - 500.0) < 30.0


def test_landing_dgps_clock(landing: Replayed) -> None:
    """The DGPS is late by 0.30 s; found to three of its sigmas, and to 50 ms."""
    offset = landing.summary["reference"]["time_offset"]
    assert offset["offset_s"] == pytest.approx(0.30, abs=min(0.05, 3 * offset["sigma_s"] + 0.01))


def test_landing_consistency_is_reported(landing: Replayed, classic_landing: Replayed) -> None:
    total = classic_landing.summary["accuracy"]["truth"]["total"]
    assert 0.7 < total["anees"] < 1.4
    assert all(0.3 < r < 1.3 for r in total["bound"]["ekf_over_track"])
    total = landing.summary["accuracy"]["truth"]["total"]
    assert 0.05 < total["anees"] < 1.4
    assert all(r > 0.3 for r in total["bound"]["ekf_over_track"])
    assert all(r < 1.3 for r in total["bound"]["ekf_over_track"])


@dataclass(frozen=True)
class Sight:
    """One detection next to the truth: its error, and whether nose and silhouette were in the searched window."""

    t_s: float
    width_px: int
    error_px: np.ndarray
    sigma_px: np.ndarray
    nose_inside: bool
    silhouette_inside: bool


def sights(run: Replayed, session: Path) -> list[Sight]:
    """Return the detections in whose frame the nose is; those without a point have a NaN error."""
    found = []
    with np.load(session / "masks.npz") as masks:
        for row in read(run.folder / "detections.csv"):
            epoch = int(np.argmin(np.abs(run.truth["t_s"] - float(row["t_s"]))))
            nose = np.array([run.truth[f"{row['station']}_{c}_px"][epoch] for c in "uv"])
            if not row["roi_x_px"] or not np.isfinite(nose).all():
                continue
            mask, corner = (masks[f"{row['station']}_{epoch:04d}{end}"] for end in ("", "_xy"))
            low = np.array([float(row["roi_x_px"]), float(row["roi_y_px"])])
            high = low + [float(row["roi_w_px"]), float(row["roi_h_px"])]
            inside = np.all(corner >= low) and np.all(corner + mask.shape[::-1] <= high)
            point, sigma = (np.array([float(row[f"{name}{c}_px"] or "nan") for c in "uv"]) for name in ("", "sigma_"))
            found.append(
                Sight(
                    t_s=float(row["t_s"]),
                    width_px=int(np.ptp(np.flatnonzero(mask.any(axis=0)))) + 1,
                    error_px=point - nose,
                    sigma_px=sigma,
                    nose_inside=bool(np.all(nose >= low - 0.5) and np.all(nose <= high - 0.5)),
                    silhouette_inside=bool(inside),
                )
            )
    return found


@pytest.mark.parametrize(("detector", "least_square"), [("landing", 0.05), ("classic_landing", 0.2)])
def test_landing_target_point_on_sky(
    detector: str, least_square: float, landing_1: Path, request: pytest.FixtureRequest
) -> None:
    """On sky (until 26.2 s), 15–100 px wide: rms at most 1 px in u and 0.7 px in v, and within the stated sigmas."""
    seen = [
        s for s in sights(request.getfixturevalue(detector), landing_1) if s.t_s <= 26.25 and 15 <= s.width_px < 100
    ]
    assert len(seen) > 480
    errors = np.array([s.error_px for s in seen])
    assert np.isfinite(errors).mean() > 0.99
    assert np.all(np.sqrt(np.nanmean(errors**2, axis=0)) <= [1.0, 0.7])
    # one flight has one crab and one incidence: that its errors are no larger than stated is all that it can show
    squares = np.nanmean((errors / np.array([s.sigma_px for s in seen])) ** 2)
    assert least_square < squares <= 1.21


def test_the_region_of_interest_holds_nose_and_silhouette(landing: Replayed, landing_1: Path) -> None:
    seen = sights(landing, landing_1)
    assert len(seen) > 600
    assert np.mean([s.nose_inside for s in seen]) >= 0.999
    assert np.mean([s.silhouette_inside for s in seen]) >= 0.999


def test_the_region_of_interest_holds_an_aircraft_overhead(takeoff: Replayed, takeoff_1: Path) -> None:
    """Climbing over the cameras it hangs below its nose, 350 px wide; a wing tip and the tail stayed outside."""
    seen = sights(takeoff, takeoff_1)
    assert sum(s.width_px > 200 for s in seen) > 70
    # of the pictures in which it is as wide and has its nose, nearly all were processed
    truth = takeoff.truth
    with np.load(takeoff_1 / "masks.npz") as masks:
        wide = [
            name
            for side in ("left", "right")
            for k in np.flatnonzero(np.isfinite(truth[f"{side}_u_px"]))
            if np.ptp(np.flatnonzero(masks[name := f"{side}_{k:04d}"].any(axis=0))) + 1 > 200
        ]
    assert sum(s.width_px > 200 for s in seen) > 0.9 * len(wide)
    assert np.mean([s.nose_inside for s in seen]) >= 0.999
    assert np.mean([s.silhouette_inside for s in seen]) >= 0.999


@dataclass(frozen=True)
class Bird:
    """Where the bird is against the aircraft in one camera's picture of each epoch, as picture and silhouette show."""

    covered: np.ndarray
    """Share (n,) of the silhouette that is as dark as nothing but the bird."""
    away_spans: np.ndarray
    """Distance (n,) between the nose and what is so dark, in widths of the silhouette; NaN without a nose or a bird."""


def bird_in(session: Path, station: str) -> Bird:
    """Find the bird, the darkest object in these pictures: below the shade of the trees and of the aircraft."""
    truth = np.genfromtxt(session / "truth.csv", delimiter=",", names=True)
    covered, away = np.zeros(len(truth)), np.full(len(truth), np.nan)
    film = cv2.VideoCapture(str(session / f"{station}.avi"))
    with np.load(session / "masks.npz") as masks:
        for k in range(len(truth)):
            read_one, picture = film.read()
            assert read_one, k
            nose = np.array([truth[f"{station}_{c}_px"][k] for c in "uv"])
            if not np.isfinite(nose).all():
                continue
            mask, (x, y) = (masks[f"{station}_{k:04d}{end}"] for end in ("", "_xy"))
            dark = cv2.morphologyEx(cv2.inRange(picture, (0,) * 3, (71,) * 3) & 1, cv2.MORPH_OPEN, np.ones((5, 5)))
            under = dark[y : y + mask.shape[0], x : x + mask.shape[1]]
            covered[k] = under[mask[: under.shape[0], : under.shape[1]] > 0].mean()
            places = cv2.findNonZero(dark)
            if places is not None:
                span_px = np.ptp(np.flatnonzero(mask.any(axis=0))) + 1
                away[k] = np.hypot(*(places.reshape(-1, 2) - nose).T).min() / span_px
    film.release()
    return Bird(covered=covered, away_spans=away)


def test_takeoff_accuracy(takeoff: Replayed) -> None:
    """At most 0.035/0.65/0.04 m at y 100–250 m and 0.06/0.2/0.06 below 100 m while in view."""
    assert np.all(takeoff.rmse(100, 250) <= [0.035, 0.65, 0.04])
    in_view = [r for r in takeoff.track if r["status"] == "tracking"]
    t = np.array([float(r["t_s"]) for r in in_view])
    x = np.array([[float(r[k]) for k in ("x_m", "y_m", "z_m")] for r in in_view])
    true = np.column_stack([np.interp(t, takeoff.truth["t_s"], takeoff.truth[k]) for k in ("x_m", "y_m", "z_m")])
    near = true[:, 1] < 100
    assert near.sum() > 40
    # of the epochs below 100 m in which both cameras have the nose, nearly all
    seen = np.isfinite(takeoff.truth["left_u_px"]) & np.isfinite(takeoff.truth["right_u_px"])
    assert near.sum() > 0.9 * (seen & (takeoff.truth["y_m"] < 100)).sum()
    assert np.all(np.sqrt(((x - true)[near] ** 2).mean(axis=0)) <= [0.06, 0.2, 0.06])


def frames_around(bird: Bird, over: int) -> list[int]:
    """The frames next to that with the bird over the nose: it passes by 0.3 spans a frame, and is within 1.2 spans."""
    around = []
    for way in (-1, 1):
        k = over + way
        while bird.away_spans[k] < 1.2:
            around.append(k)
            k += way
    return around


def test_takeoff_status_shows_where_there_is_no_fix(takeoff: Replayed, takeoff_1: Path) -> None:
    """Out of view: no tracking. With the bird over the right nose or near it a pixel is true to its stated sigma.

    In the frames around it the nose is in plain sight, as the pictures show, the bird over a wing or past it. A pixel
    is claimed, and the track is a tracking one, in all of them but perhaps the one before, in which the bird hides a
    wing up to the fuselage.
    """
    bird = bird_in(takeoff_1, "right")
    # it covers a quarter of the silhouette over the nose, and 0.07 at most elsewhere
    (over,) = np.flatnonzero(bird.covered > 0.15)
    assert bird.away_spans[over] < 0.02
    hidden = ~np.isfinite(takeoff.truth["left_u_px"]) | ~np.isfinite(takeoff.truth["right_u_px"])
    gone = takeoff.truth["t_s"][hidden]
    for row in takeoff.track:
        if np.abs(gone - float(row["t_s"])).min() < 1e-3:
            assert row["status"] != "tracking", row["t_s"]
    around = frames_around(bird, over)
    assert len(around) >= 6
    found = [r for r in read(takeoff.folder / "detections.csv") if r["station"] == "right"]
    claims = [(k, found[k]) for k in (*around, over) if found[k]["status"] == "ok"]
    clear = {k for k in around if bird.covered[k] < 0.03}
    assert len(around) - len(clear) <= 1
    assert clear <= {k for k, _ in claims}
    tracking = [abs(float(r["t_s"])) for r in takeoff.track if r["status"] == "tracking"]
    assert all(np.abs(np.array(tracking) - takeoff.truth["t_s"][k]).min() < 1e-3 for k in clear)
    for k, row in claims:
        for c in "uv":
            sigma = float(row[f"sigma_{c}_px"])
            assert float(row[f"{c}_px"]) == pytest.approx(takeoff.truth[f"right_{c}_px"][k], abs=3.5 * sigma)
            # and a pixel that is no more than a guess says so
            assert sigma < 20.0
    # the frame after has the bird's wing where the nose's picture ends: measured 24 px off at a stated 19
    off = {k: np.hypot(*(float(r[f"{c}_px"]) - takeoff.truth[f"right_{c}_px"][k] for c in "uv")) for k, r in claims}
    assert sum(off[k] > 4.5 * 2**0.5 for k in clear) <= 1


def test_classic_takeoff_shows_where_there_is_no_fix(classic_takeoff: Replayed, takeoff_1: Path) -> None:
    """The classic detector does not guess a hidden nose: with the bird over it there is no tracking."""
    bird, truth = bird_in(takeoff_1, "right"), classic_takeoff.truth
    (over,) = np.flatnonzero(bird.covered > 0.15)
    hidden = ~np.isfinite(truth["left_u_px"]) | ~np.isfinite(truth["right_u_px"])
    hidden[over] = True
    gone = truth["t_s"][hidden]
    for row in classic_takeoff.track:
        if np.abs(gone - float(row["t_s"])).min() < 1e-3:
            assert row["status"] != "tracking", row["t_s"]
    found = [r for r in read(classic_takeoff.folder / "detections.csv") if r["station"] == "right"]
    for k in frames_around(bird, over):
        if found[k]["status"] != "ok":
            continue
        for c in "uv":
            assert float(found[k][f"{c}_px"]) == pytest.approx(truth[f"right_{c}_px"][k], abs=4.5)


def test_takeoff_dgps_clock(takeoff: Replayed) -> None:
    """Late by 0.15 s."""
    offset = takeoff.summary["reference"]["time_offset"]
    assert offset["offset_s"] == pytest.approx(0.15, abs=0.04)
    # measured: 3.4 ms off and 3.7 ms stated
    assert 0.001 < offset["sigma_s"] < 0.01


def test_takeoff_consistency_is_reported(takeoff: Replayed, classic_takeoff: Replayed) -> None:
    """Measured: ANEES 0.13; with the classic detector 0.69, and 0.41, 0.57 and 0.61 of the bound along x, y and z."""
    total = classic_takeoff.summary["accuracy"]["truth"]["total"]
    assert 0.4 < total["anees"] < 1.4
    assert all(0.3 < r < 1.3 for r in total["bound"]["ekf_over_track"])
    total = takeoff.summary["accuracy"]["truth"]["total"]
    assert 0.05 < total["anees"] < 1.4
    assert all(0.1 < r < 1.3 for r in total["bound"]["ekf_over_track"])


def edited(session: Path, to: Path, edits: dict[str, Callable[[list[str]], list[str]]]) -> Path:
    """Copy a session with some of its text files changed line by line; videos are linked."""
    to.mkdir()
    for item in session.iterdir():
        if item.name in edits:
            (to / item.name).write_text("\n".join(edits[item.name](item.read_text().splitlines())) + "\n")
        elif item.suffix in (".mp4", ".avi"):
            (to / item.name).symlink_to(item)
        elif item.suffix in (".csv", ".toml"):
            shutil.copy(item, to / item.name)
    return to


def test_takeoff_with_late_stamps_missing_frames_and_thinned_ptu(
    takeoff_1: Path, takeoff: Replayed, tmp_path: Path
) -> None:
    """Right stamps 20 ms late with that camera_clock, every tenth right frame missing, every second PTU
    row gone: errors stay within 1.2 × of 0.06/0.9/0.06 m. It passes y = 100 m at 10.05 s, and what follows is not
    replayed."""

    def frames(lines: list[str]) -> list[str]:
        out = lines[:1]
        for k, line in enumerate(lines[1:]):
            index, left, right = line.split(",")
            late = "" if k % 10 == 9 else f"{float(right) + 0.02:.6f}"
            out.append(f"{index},{left},{late}")
        return out

    def rig(lines: list[str]) -> list[str]:
        at = max(i for i, line in enumerate(lines) if line.startswith("ptu_clock"))
        return [
            *lines[: at + 1],
            "camera_clock = { offset_s = -0.02, drift_ppm = 0.0, sigma_s = 0.0005 }",
            *lines[at + 1 :],
        ]

    session = edited(
        takeoff_1,
        tmp_path / "session",
        {"frames.csv": frames, "rig.toml": rig, "ptu.csv": lambda lines: [lines[0], *lines[1::2]]},
    )
    harder = replayed(session, tmp_path / "out", to_s=10.1)
    assert np.all(harder.rmse(100, 250) <= 1.2 * np.array([0.06, 0.9, 0.06]))
    assert harder.summary["counts"]["detection"]["right"]["status"]["ok"] > 140


def spoilt_dgps(lines: list[str]) -> list[str]:
    """DGPS held constant for 2 s at 12 s, then resumed with a lag that grows."""
    out, held = lines[:1], None
    rows = [[float(c) for c in line.split(",")] for line in lines[1:]]
    times = np.array([r[0] for r in rows])
    points = np.array([r[1:] for r in rows])
    for r in rows:
        t = r[0]
        if t < 12.0:
            held = r[1:]
            out.append(",".join(f"{v:.5f}" for v in r))
        elif t < 14.0:
            out.append(",".join(f"{v:.5f}" for v in [t, *held]))
        else:
            lag = 0.4 + 0.05 * (t - 14.0)
            moved = [np.interp(t - lag, times, points[:, k]) for k in range(3)]
            out.append(",".join(f"{v:.5f}" for v in [t, *moved]))
    return out


def test_the_same_pictures_give_the_same_track(landing: Replayed, lossless_landing: Path, tmp_path: Path) -> None:
    """Byte for byte, whatever the DGPS that is only a comparison; up to 15 s, where it has been wrong for 3 s.

    The pictures are the same, and coded without loss.
    """
    session = edited(lossless_landing, tmp_path / "session", {"dgps.csv": spoilt_dgps})
    again = replayed(session, tmp_path / "out", to_s=15.0)
    assert float(again.track[-1]["t_s"]) > 14.8
    for name in ("track.csv", "triangulation.csv", "track.tum"):
        own = (again.folder / name).read_bytes()
        assert own.count(b"\n") > 100
        assert (landing.folder / name).read_bytes()[: len(own)] == own


def test_frozen_then_lagging_dgps_is_found(landing: Replayed, landing_1: Path, tmp_path: Path) -> None:
    """Both stretches excluded, with the reason; the offset is still that of the good part."""
    pixels = by_pixels(landing_1, landing.folder / "detections.csv", tmp_path / "pixels")
    session = edited(pixels, tmp_path / "session", {"dgps.csv": spoilt_dgps})
    found = replayed(session, tmp_path / "out").summary["reference"]
    reasons = {span["reason"] for span in found["excluded"]}
    assert {"frozen", "lagging"} <= reasons
    covered = sum(span["to_s"] - span["from_s"] for span in found["excluded"])
    assert covered > 10.0
    assert found["time_offset"]["offset_s"] == pytest.approx(0.30, abs=0.06)


def taught_and_judged(split: Split, seen: Path, folder: Path, config: Path | None = None) -> None:
    """Perturb the rig, calibrate it by one part of the flight, evaluate on the rest by the pixels of a replay."""
    session = by_pixels(split.session, seen, folder / "pixels")
    stated, found = folder / "stated.toml", folder / "found.toml"
    stated.write_text(rig_to_toml(spoilt_rig(split)))
    (taught, until), (first, last) = split.taught_s, split.judged_s
    fit = calibrate_flight(
        FlightRequest(session=session, rig=stated, out=found, from_s=taught, to_s=until, free=split.free)
    ).fit
    true, exact = load_rig(split.session / "rig.toml"), load_rig(found)
    for name, sigma in zip(fit.problem.names, fit.sigma, strict=True):
        station, _, short = name.partition(".")
        if short == "ptu_clock.offset":
            off = exact[station].ptu_clock.offset_s - true[station].ptu_clock.offset_s
            assert abs(off) < 3.5 * np.hypot(sigma, true[station].ptu_clock.sigma_s)
            assert sigma < 2.5e-3
    ours, theirs = (
        truth_rmse(session, replayed_as(session, folder / label, rig, from_s=first, to_s=last, config=config))
        for label, rig in (("found", found), ("true", None))
    )
    if config is not None:
        assert np.all(ours <= 1.5 * theirs)
    # the learned channel's errors on the true rig are below what is aimed at, and below a calibration's
    assert np.all(ours <= np.maximum(1.5 * theirs, [0.035, 0.45, 0.04]))


def test_mounts_off_by_a_tenth_of_a_degree_are_found_by_part_of_a_landing(
    landing: Replayed, classic_landing: Replayed, classic: Path, tmp_path: Path
) -> None:
    """Calibrated up to 20 s, evaluated from there on."""
    for run, config in ((landing, None), (classic_landing, classic)):
        folder = tmp_path / run.folder.name
        folder.mkdir()
        taught_and_judged(splits(Path())[0], run.folder / "detections.csv", folder, config)


@pytest.mark.parametrize("part", [1, 2])
def test_a_delay_of_40_ms_is_found_by_part_of_a_take_off(
    takeoff: Replayed, shared_data: Path, tmp_path: Path, part: int
) -> None:
    """Calibrated where there is DGPS and evaluated where there is none; up to 9 s and evaluated from there on."""
    taught_and_judged(splits(shared_data)[part], takeoff.folder / "detections.csv", tmp_path)
