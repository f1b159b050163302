"""The ground paper's figure 13: scenes with the prediction out of the field of view, and their detections."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.estimation.config import EstimationConfig, OutOfViewWeighting
from groundstation.estimation.out_of_view_weight import paper_weight, probability_in_view
from groundstation.estimation.station_ekf import StationEkf
from groundstation.experiments import detection_plots as plots
from groundstation.experiments.experiment import Findings, PaperFigure
from groundstation.experiments.tables import Cell, ResultTable
from groundstation.experiments.truth_session import TruthSession
from groundstation.geometry.aim import aim_at
from groundstation.rig.rig import Station

# the border that each of the paper's four scenes is put at, and how far beyond it the aircraft truly is, px
_SCENES = {"A": ((-1, 0), 20.0), "B": ((1, 0), 40.0), "C": ((0, -1), 60.0), "D": ((0, 1), 90.0)}
_DRAWS = 40
# the prediction is uncertain by some 20 px at any range; along the runway by metres
_START_SIGMA_SHARE, _START_SIGMA_Y_M = 0.003, 4.0
_DETECTION_SIGMA_PX = 1.0
_ANGLE_SIGMA_RAD = 3e-5
_FORMS = {
    OutOfViewWeighting.CONSISTENT: "R/T",
    OutOfViewWeighting.GAIN: "T·K, Joseph",
    OutOfViewWeighting.PAPER: "the paper's",
}
_GUARDED = "R/T as it is used: gate, no look below 2 %"


def leaving(recorded: TruthSession) -> Findings:
    """Four scenes with the prediction out of view, and the error by form of correction (figure 13)."""
    place = _place(recorded)
    shown: list[list[Cell]] = []
    spread: list[list[Cell]] = []
    pictures = {}
    for name, scene in _SCENES.items():
        example = _once(recorded, place, scene, OutOfViewWeighting.PAPER, 0)
        pictures[name] = example
        corrected = example.weight * example.detected + (1.0 - example.weight) * example.predicted
        values = (*example.predicted, *example.detected, *corrected, *example.true)
        shown.append([name, *(float(v) for v in values), example.weight, example.mass])
        ways = [(words, form, False) for form, words in _FORMS.items()]
        for words, form, guarded in (*ways, (_GUARDED, OutOfViewWeighting.CONSISTENT, True)):
            drawn = [_once(recorded, place, scene, form, seed, guarded=guarded) for seed in range(_DRAWS)]
            rms = np.sqrt(np.mean([d.error_m**2 for d in drawn], axis=0))
            before = np.sqrt(np.mean([d.prior_error_m**2 for d in drawn], axis=0))
            anees = float(np.mean([d.nees for d in drawn]))
            spread.append([name, words, *(float(v) for v in (*before, *rms)), anees])
    scenes = ResultTable(
        name="out_of_view_scenes",
        title="Figure 13: four scenes with the prediction out of the field of view, left camera",
        columns=(
            *("scene", "predicted u px", "v", "detected u px", "v", "corrected u px", "v", "true u px", "v"),
            *("T, paper", "mass inside, ours"),
        ),
        rows=shown,
        notes=("Corrected is the paper's T·detected + (1 − T)·predicted. One draw of each scene.",),
    )
    errors = ResultTable(
        name="out_of_view_errors",
        title="Figure 13: error after one such picture, by form of correction",
        columns=("scene", "form", "before x m", "y m", "z m", "after x m", "y m", "z m", "ANEES after"),
        rows=spread,
        notes=(
            f"{_DRAWS} draws of each scene; 1 is ideal for ANEES. What is detected is the border's pixel nearest to "
            "the aircraft, as the last of a silhouette that is cut: it is wrong by as much as the aircraft is outside.",
            "All forms are consistent but the paper's for right detections of a target about the border "
            '(docs/notes/position.md, "Out of view"). A wrong one makes R/T overconfident, too, and the gate sees it '
            "only where it is further off than the prediction is uncertain, here by some 20 px; T·K suffers least. Our "
            "detector gives no such pixel: a silhouette cut by the border is a miss of its own, and below 2 % in view "
            "it does not look.",
        ),
    )
    figure = PaperFigure(
        name="out_of_view",
        title="Figure 13: predicted, detected, corrected and true pixel",
        caption="The frame is the picture of the left camera.",
        draw=lambda path: _draw(pictures, recorded.session.rig.stations[0].lens.image_size_px, path),
    )
    differences = (
        "The paper shows four pictures of its landing, marked A to D in figure 11; its pictures are not ours, so the "
        "geometry is put there: the recorded rig, the aircraft at a place of the recorded path, heads turned away.",
        "The paper's form scales the innovation but lets the covariance shrink as if T were 1, hence its ANEES.",
    )
    return Findings(tables=(scenes, errors), figures=(figure,), differences=differences)


class _Realisation:
    """One draw: pixels (2,), weights, and the position's error (3,) before and after, with its NEES."""

    def __init__(
        self, ekf: StationEkf, station: Station, truth_m: FloatArray, true_px: FloatArray, border_px: FloatArray
    ) -> None:
        self._ekf, self._station, self._truth_m = ekf, station.name, truth_m
        self.true, self.detected = true_px, border_px
        prediction = ekf.predict_pixel(station.name)
        if prediction is None:
            raise ValueError("the aircraft is ahead of the camera by the scene's making")
        size = station.lens.image_size_px
        self.predicted: FloatArray = prediction.pixel.copy()
        S = prediction.jacobian @ ekf.covariance @ prediction.jacobian.T
        self.weight = paper_weight(self.predicted, size, EstimationConfig().paper_border_sigma_px)
        self.mass = probability_in_view(self.predicted, S, size)
        self.prior_error_m: FloatArray = self._error()

    def _error(self) -> FloatArray:
        return np.asarray(self._ekf.state[self._ekf.layout.position] - self._truth_m)

    def correct(self, least_mass: float) -> "_Realisation":
        """Let the detection update the filter, if so much of the prediction is in view."""
        if self.mass >= least_mass:
            self._ekf.update_pixel(self._station, self.detected, _DETECTION_SIGMA_PX**2 * np.eye(2))
        self.error_m = self._error()
        own = self._ekf.layout.position
        self.nees = float(self.error_m @ np.linalg.solve(self._ekf.covariance[own, own], self.error_m)) / 3.0
        return self


def _once(
    recorded: TruthSession,
    place: FloatArray,
    scene: tuple[tuple[int, int], float],
    form: OutOfViewWeighting,
    seed: int,
    *,
    guarded: bool = False,
) -> _Realisation:
    """Turn the heads away, start the filter with a drawn error, and show the left camera the border."""
    rng = np.random.default_rng([seed, *place.astype(np.int64).tolist(), 3])
    rig = recorded.session.rig
    usual = EstimationConfig()
    config = replace(usual, out_of_view=form, gate_probability=usual.gate_probability if guarded else 1.0 - 1e-12)
    ekf = StationEkf({s.name: s.geometry() for s in rig.stations}, rig.names, config)
    ekf.predict_to(0.0)
    (across, down), beyond_px = scene
    first = rig.stations[0]
    size, lens = first.lens.image_size_px, first.lens
    true_px = np.zeros(2)
    for station in rig.stations:
        geometry = station.geometry()
        aim = aim_at(geometry, place)
        if aim is None:
            raise ValueError("a place of the recorded path can be aimed at")
        pan, tilt = aim.pan_rad, aim.tilt_rad
        if station is first:
            # panning left moves the picture right, tilting up moves it down
            pan += across * (size[0] / 2 + beyond_px) / lens.focal_px[0]
            tilt += down * (size[1] / 2 + beyond_px) / lens.focal_px[1]
            seen = geometry.project(place, pan, tilt)
            if seen is None:
                raise ValueError("the aircraft is ahead of the camera by the scene's making")
            true_px = seen.pixel
        ekf.set_angles(station.name, (pan, tilt), (0.0, 0.0), _ANGLE_SIGMA_RAD)
    across_m = _START_SIGMA_SHARE * float(place[1])
    sigma = np.array([across_m, _START_SIGMA_Y_M, across_m, 1.0, 2.0, 1.0])
    draw = rng.normal(0.0, sigma)
    velocity = recorded.velocity_at(float(recorded.truth.t_s[recorded.inside(recorded.truth.t_s)][0]))
    ekf.start_target(place + draw[:3], velocity + draw[3:], np.diag(sigma**2))
    border = np.clip(true_px, 0.0, np.array(size) - 1.0) + rng.normal(0.0, _DETECTION_SIGMA_PX, 2)
    return _Realisation(ekf, first, place, true_px, np.clip(border, 0.0, np.array(size) - 1.0)).correct(
        usual.min_view_probability if guarded else 0.0
    )


def _place(recorded: TruthSession) -> FloatArray:
    """Return the path's place in the middle of the part that is studied."""
    t = recorded.truth.t_s[recorded.inside(recorded.truth.t_s)]
    return np.asarray(recorded.truth_at(t[len(t) // 2 : len(t) // 2 + 1])[0])


def _draw(pictures: dict[str, _Realisation], size: tuple[int, int], path: Path) -> None:
    figure, panels = plots.blank(2, 2, (9.0, 7.2))
    for ax, (name, seen) in zip(panels, pictures.items(), strict=True):
        ax.plot([0, size[0], size[0], 0, 0], [0, 0, size[1], size[1], 0], color="#444444", lw=1)
        corrected = seen.weight * seen.detected + (1.0 - seen.weight) * seen.predicted
        marked = (("predicted", seen.predicted), ("detected", seen.detected), ("corrected", corrected))
        for k, (label, pixel) in enumerate((*marked, ("true", seen.true))):
            ax.plot(*pixel, plots.MARKERS[k], ms=6, color=plots.COLOURS[k], label=label)
        ax.set_title(f"scene {name}, T = {seen.weight:.2f}", fontsize=10)
        about = 200.0
        ax.set_xlim(seen.true[0] - about, seen.true[0] + about)
        ax.set_ylim(seen.true[1] + about, seen.true[1] - about)
    panels[0].legend(frameon=False, fontsize=8)
    plots.save(figure, path)
