"""Whether the detector's stated covariance holds over aircraft, attitudes and lights, which no one flight can show.

    python benchmarks/drawn_aircraft.py [OUT] [--flights N] [--first SEED] [--rate HZ] [--crab DEG]
        [--workers N]

Flights are drawn: landings and take-offs in turn, in gusts, each with its own proportions, paint, crab, incidence, sun,
clouds and scenery; the attitude follows the path's mean over a time that is drawn, too. Each is filmed into OUT (those
that are there already are taken as they are), replayed, and every look judged against the truth. Crab, incidence and
shape last as long as a flight, so that flights are what is drawn, not frames: the bounds are the 95 % of chi-squared
for two degrees of freedom of each flight, one across and one along the picture's height. What is stated as new in each
frame is judged by itself, with bounds for frames, and flight by flight, since how even an outline is differs from one
aircraft to the next.
"""

import argparse
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from detector_on_rendered import flown
from parallel_study import STUDIES, StudyRun, add_study_arguments, as_json
from scipy.stats import chi2
from scipy.stats import t as t_of

from groundstation.arrays import FloatArray
from groundstation.box import Box
from groundstation.evaluation.covariance_parts import noise_chi_square
from groundstation.experiments.detection_tables import stated_errors
from groundstation.experiments.detector_outcomes import DetectorOutcome
from groundstation.simulation.airframes.trainer import AirframeShape, trainer
from groundstation.simulation.attitude import AircraftPose, pose_at
from groundstation.simulation.flights import SPAN_M, FlightName, flight, rendered_scenario, site_rig
from groundstation.simulation.rendered_camera import RenderedCamera
from groundstation.simulation.rendered_scene import RenderedScene
from groundstation.simulation.rendered_session_folder import write_rendered_session
from groundstation.simulation.scenery import Scenery
from groundstation.simulation.simulate import simulate
from groundstation.simulation.trajectory import Trajectory

_STREAM = 907
_STEP_S = 0.02
_WIDTHS_PX = ((15, 40), (40, 60), (60, 80), (80, 100), (100, 120), (120, 200), (200, 2000))
_PAINTS = ((205.0, 208.0, 210.0), (170.0, 172.0, 175.0), (60.0, 190.0, 235.0), (120.0, 70.0, 50.0), (70.0, 66.0, 64.0))
_TRIMS = ((44.0, 36.0, 150.0), (150.0, 60.0, 30.0), (40.0, 40.0, 42.0), (60.0, 140.0, 230.0))
_AIRBORNE_M = 1.5
_LEAST_FRAMES = 4
_FAR_PX, _LEAST_DIFFERENCES = 100, 20


class _AveragedVelocity:
    """A trajectory whose velocity is averaged over a window in s; the attitude follows it."""

    def __init__(self, flown: Trajectory, over_s: float) -> None:
        self._flown, self.span_s = flown, flown.span_s
        start, end = flown.span_s
        self._t = np.arange(start - over_s - 1.0, end + over_s + 1.0, _STEP_S)
        count = max(round(over_s / _STEP_S), 1)
        velocity = flown.velocity(self._t)
        self._velocity = np.column_stack([np.convolve(v, np.full(count, 1.0 / count), "same") for v in velocity.T])

    def position(self, t_s: FloatArray) -> FloatArray:
        return self._flown.position(t_s)

    def velocity(self, t_s: FloatArray) -> FloatArray:
        return np.column_stack([np.interp(t_s, self._t, v) for v in self._velocity.T])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DisturbedAttitudeScene(RenderedScene):
    """A scene whose aircraft has attitude errors relative to its direction of flight.

    ``crab`` and ``pitch`` are mean and size (rad), rate (rad/s) and phase of a slow wave, none on its wheels; ``held``
    is the flight that its attitude follows.
    """

    crab: tuple[float, float, float, float] = (0.0, 0.0, 1.0, 0.0)
    pitch: tuple[float, float, float, float] = (0.0, 0.0, 1.0, 0.0)
    held: Trajectory | None = None

    def aircraft_at(self, t_s: float) -> AircraftPose:
        """Return the aircraft's pose at a time, s."""
        rest_m = self.airframe.rest_height_m
        pose = pose_at(self.trajectory if self.held is None else self.held, t_s, rest_m)
        share = float(np.clip((pose.position_runway_m[2] - rest_m) / _AIRBORNE_M, 0.0, 1.0))
        crab, pitch = (
            share * (mean + size * math.sin(rate * t_s + phase)) for mean, size, rate, phase in (self.crab, self.pitch)
        )
        cc, sc, cp, sp = math.cos(crab), math.sin(crab), math.cos(pitch), math.sin(pitch)
        yaw = np.array([[cc, -sc, 0.0], [sc, cc, 0.0], [0.0, 0.0, 1.0]])
        nose_up = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
        return AircraftPose(
            position_runway_m=pose.position_runway_m,
            velocity_runway_m_s=pose.velocity_runway_m_s,
            runway_from_body=yaw @ pose.runway_from_body @ nose_up,
        )


def film(folder: Path, seed: int, rate_hz: float, crab_rad: float) -> None:
    """Film the flight of a seed."""
    g = np.random.default_rng([seed, _STREAM])
    rig = site_rig()
    name = FlightName.LANDING if seed % 2 == 0 else FlightName.TAKE_OFF
    trajectory = flight(name, seed=seed, wind_m_s=float(g.uniform(0.0, 5.0)))
    simulated = simulate(rendered_scenario(trajectory, rig, seed=seed, frame_hz=rate_hz))
    width, height, length, chord = np.exp(g.normal(0.0, (0.10, 0.10, 0.08, 0.10)))
    shape = AirframeShape(
        fuselage_width=float(width),
        fuselage_height=float(height),
        length=float(length),
        chord=float(chord),
        wing_back=float(g.normal(0.0, 0.015)),
        wing_up=float(g.normal(0.0, 0.008)),
        skin_bgr=_PAINTS[g.integers(len(_PAINTS))],
        trim_bgr=_TRIMS[g.integers(len(_TRIMS))],
    )
    scenery = Scenery(
        seed=seed,
        cloud_cover=float(g.uniform(0.0, 0.8)),
        sun_azimuth_rad=float(g.uniform(-math.pi, math.pi)),
        sun_elevation_rad=math.radians(float(g.uniform(15.0, 65.0))),
    )
    world = DisturbedAttitudeScene(
        held=_AveragedVelocity(trajectory, float(np.exp(g.uniform(math.log(0.3), math.log(4.0))))),
        trajectory=trajectory,
        airframe=trainer(SPAN_M, shape),
        scenery=scenery,
        crab=(*(crab_rad * g.normal(0.0, (1.0, 0.4))), float(g.uniform(0.3, 1.5)), float(g.uniform(0.0, 6.28))),
        pitch=(
            *(math.radians(2.0) * g.normal(0.0, (1.0, 0.4))),
            float(g.uniform(0.3, 1.5)),
            float(g.uniform(0.0, 6.28)),
        ),
    )
    cameras = {
        s.name: RenderedCamera(world, s, seed=seed, number=number)
        for number, s in enumerate(simulated.scenario.true_rig.stations)
    }
    words = {"name": f"drawn {seed}", "origin": "rendered", "licence": "CC0", "notes": "drawn aircraft"}
    write_rendered_session(folder, simulated, cameras, words=words)


def looked_at(job: tuple[str, int, float, float]) -> list[Any]:
    """Return the looks of a flight as JSON has them, filmed first if it is not there.

    ``job`` is the film's folder, seed, rate (Hz) and one sigma of the crab (deg).
    """
    folder, seed, rate_hz, crab_deg = Path(job[0]), *job[1:]
    cv2.setNumThreads(1)
    if not (folder / "masks.npz").exists():
        film(folder, seed, rate_hz, math.radians(crab_deg))
    return [as_json(outcome) for outcome in flown(folder)]


def outcome_from_json(value: dict[str, Any]) -> DetectorOutcome:
    """Return a look from what `looked_at` returns."""
    arrays = {name: np.array(own) for name, own in value.items() if isinstance(own, list)}
    return DetectorOutcome(**value | arrays | {"roi": Box(*value["roi"])})


def table(flights: Mapping[int, Sequence[DetectorOutcome]]) -> list[str]:
    """Return a row for each bin of width: how far off, and how far in sigmas, by flight."""
    rows = [
        "| width px | flights | frames | wrong % | rms u/v % of width | NIS per dof | bounds | flights' own | "
        "noise's | jumps % |",
        "|---" * 10 + "|",
    ]
    for low, high in _WIDTHS_PX:
        bins = [[o for o in seen if o.found and low <= o.width_px < high] for seen in flights.values()]
        right = [own for own in ([o for o in seen if not o.wrong] for seen in bins) if len(own) >= _LEAST_FRAMES]
        if not right:
            continue
        own = sorted(float(np.mean([0.5 * o.whitened @ o.whitened for o in seen])) for seen in right)
        dof = 2 * len(right)
        bounds = chi2.ppf([0.025, 0.975], dof) / dof
        errors = np.array([100.0 * o.error_px / o.width_px for seen in right for o in seen])
        rms = np.sqrt(np.mean(errors**2, axis=0))
        frames = sum(map(len, bins))
        wrong = 100.0 * sum(o.wrong for seen in bins for o in seen) / frames
        cells = [
            *(f"{low}–{high}", len(right), frames, f"{wrong:.1f}", f"{rms[0]:.2f}/{rms[1]:.2f}"),
            *(f"{np.mean(own):.2f}", f"{bounds[0]:.2f}–{bounds[1]:.2f}", " ".join(f"{v:.1f}" for v in own)),
        ]
        noise = noise_chi_square([run for seen in right for run in stated_errors(seen)])
        if noise is not None:
            mean = noise.mean
            cells += [f"{mean.mean:.2f} ({mean.low:.2f}–{mean.high:.2f})", f"{100.0 * noise.jump_share:.1f}"]
        rows.append("| " + " | ".join(str(c) for c in cells) + " |")
    return rows


def noises(flights: Mapping[int, Sequence[DetectorOutcome]]) -> list[str]:
    """Return how the noise of each flight compares with what was stated for it, and what one flight more may show."""
    own: list[float] = []
    for seen in flights.values():
        far = [o for o in seen if o.found and not o.wrong and o.width_px < _FAR_PX]
        noise = noise_chi_square(stated_errors(far)) if far else None
        if noise is not None and noise.mean.count >= _LEAST_DIFFERENCES:
            own.append(noise.mean.mean)
    if len(own) < 2:
        return []
    logs = np.log(own)
    # of one flight more than these: Student's t, since mean and spread are known from so few only
    away = float(t_of.ppf(0.975, len(own) - 1) * logs.std(ddof=1) * math.sqrt(1.0 + 1.0 / len(own)))
    low, high = (math.exp(float(logs.mean()) + sign * away) for sign in (-1.0, 1.0))
    each = " ".join(f"{v:.2f}" for v in sorted(own))
    return [
        "",
        f"New in each frame below {_FAR_PX} px, flights' own: {each}; 95 % of one more: {low:.2f} to {high:.2f}",
    ]


def main() -> None:
    """Film what is not there yet, replay all, print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, metavar="OUT", nargs="?", default=STUDIES / "drawn-aircraft")
    parser.add_argument("--flights", type=int, default=16)
    parser.add_argument("--first", type=int, default=0, metavar="SEED")
    parser.add_argument("--rate", type=float, default=5.0, metavar="HZ")
    parser.add_argument("--crab", type=float, default=4.0, metavar="DEG", help="one sigma of the crab that is drawn")
    add_study_arguments(parser, "drawn-aircraft", out=False)
    options = parser.parse_args()
    jobs = {
        f"flight-{seed}": (str((options.out / str(seed)).absolute()), seed, options.rate, options.crab)
        for seed in range(options.first, options.first + options.flights)
    }
    found = StudyRun.chosen("drawn aircraft", options, options.out / "jobs").values(looked_at, jobs)
    flights: dict[int, Sequence[DetectorOutcome]] = {}
    for name, (_, seed, _, _) in jobs.items():
        flights[seed] = [outcome_from_json(value) for value in found[name]]
        print(f"flight {seed}: {len(flights[seed])} looks")
    print("\n".join([*table(flights), *noises(flights)]))


if __name__ == "__main__":
    main()
