"""Simulation of a scenario: the time-ordered events that a live system would receive, and the exact truth."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray, MaskArray
from groundstation.messages import DgpsFix, Epoch, Event, PixelMeasurement
from groundstation.rig.rig import Rig
from groundstation.simulation.detection_camera import SimulatedDetections, simulate_detections
from groundstation.simulation.device_clocks import stated_times
from groundstation.simulation.dgps import take_fixes
from groundstation.simulation.pointing import FixedPointing, PointingHistory, pointing_history
from groundstation.simulation.ptu import read_ptu
from groundstation.simulation.scenario import Scenario

# of what arrives at one instant, readings come first and an epoch after its frames
_READING, _PIXEL, _EPOCH = range(3)
# each random stream has its own number, so that an additional draw in one does not change the others; 0 is not used,
# because numpy treats a seed followed by zeros as the seed alone, which the scenario may have used itself
_PTU_STREAM, _CAMERA_STREAM, _DGPS_STREAM = range(101, 104)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StationTruth:
    """Truth of one station, one row for each of n stereo pairs, at its own exposures.

    Attributes
    ----------
    t_s : (n,) mid-exposures, true session time.
    pixel_px : (n, 2) the target's true pixel; zero where it is behind the camera.
    visible : (n,) whether that is in the image.
    reported : (n,) whether a pixel was reported; ``outlier`` (n,) whether that was a gross outlier.
    angles_rad, rates_rad_s : (n, 2) pan and tilt of the head and their rates.
    """

    t_s: FloatArray
    pixel_px: FloatArray
    visible: MaskArray
    reported: MaskArray
    outlier: MaskArray
    angles_rad: FloatArray
    rates_rad_s: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlightTruth:
    """Truth of a flight, one row for each of n stereo pairs.

    ``t_s`` (n,) is the mean of the pair's true mid-exposures; ``position_runway_m`` and ``velocity_runway_m_s``
    (n, 3) are the target point's then. ``stations`` by name.
    """

    t_s: FloatArray
    position_runway_m: FloatArray
    velocity_runway_m_s: FloatArray
    stations: Mapping[str, StationTruth]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SimulatedFlight:
    """A flight as received by a live system, with the truth for the evaluation.

    Attributes
    ----------
    events : in the order of their arrival; stamps are the devices' own, mapped to session time by ``rig``.
    arrival_s : (m,) true session time of each event's arrival.
    dgps : fixes in the DGPS clock.
    rig : the stated rig.
    truth : of the flight.
    scenario : the input.
    """

    events: tuple[Event, ...]
    arrival_s: FloatArray
    dgps: tuple[DgpsFix, ...]
    rig: Rig
    truth: FlightTruth
    scenario: Scenario


@dataclass(frozen=True, slots=True, kw_only=True)
class _Arrival:
    """An event with its arrival and its rank among those that arrive at the same instant."""

    t_s: float
    rank: int
    event: Event


def simulate(scenario: Scenario) -> SimulatedFlight:
    """Fly a scenario; the same scenario gives the same flight, to the last bit."""
    start, end = scenario.trajectory.span_s
    pairs_s = start + np.arange(int(np.floor((end - start) * scenario.frame_hz + 1e-9)) + 1) / scenario.frame_hz
    histories = _histories(scenario)
    detections = _detections(scenario, histories, pairs_s)
    lead = (start - scenario.lead_s, end + scenario.lead_s)
    arrivals = [*_readings(scenario, histories, lead), *_pixels_and_epochs(scenario, detections)]
    # sorted() is stable: what one unit sent stays in its order
    ordered = sorted(arrivals, key=lambda a: (a.t_s, a.rank))
    fixes = (
        ()
        if scenario.dgps is None
        else take_fixes(scenario.dgps, scenario.trajectory, lead, _generator(scenario, _DGPS_STREAM, 0))
    )
    return SimulatedFlight(
        events=tuple(a.event for a in ordered),
        arrival_s=np.array([a.t_s for a in ordered]),
        dgps=fixes,
        rig=scenario.rig,
        truth=_truth(scenario, detections),
        scenario=scenario,
    )


def _generator(scenario: Scenario, stream: int, number: int) -> np.random.Generator:
    return np.random.default_rng([scenario.seed, stream, number])


def _histories(scenario: Scenario) -> dict[str, PointingHistory]:
    """Return the pointing history of each true station; a fixed one is at zero."""
    start, end = scenario.trajectory.span_s
    # readings lead in and out, phases and rolling shutters reach a little further
    phases = [abs(c.phase_s) for c in scenario.cameras.values()]
    reach = scenario.lead_s + max(phases) + max(abs(s.readout_s) for s in scenario.true_rig.stations)
    span = (start - reach, end + reach)
    return {
        s.name: pointing_history(
            FixedPointing() if s.fixed else scenario.ptus[s.name].pointing, s.geometry(), scenario.trajectory, span
        )
        for s in scenario.true_rig.stations
    }


def _detections(
    scenario: Scenario, histories: dict[str, PointingHistory], pairs_s: FloatArray
) -> dict[str, SimulatedDetections]:
    return {
        s.name: simulate_detections(
            *(scenario.cameras[s.name], s.geometry(), s.readout_s, histories[s.name], scenario.trajectory),
            pairs_s + scenario.cameras[s.name].phase_s,
            _generator(scenario, _CAMERA_STREAM, number),
        )
        for number, s in enumerate(scenario.true_rig.stations)
    }


def _readings(scenario: Scenario, histories: dict[str, PointingHistory], span_s: tuple[float, float]) -> list[_Arrival]:
    arrivals = []
    for number, station in enumerate(scenario.true_rig.stations):
        if station.fixed:
            continue
        name = station.name
        generator = _generator(scenario, _PTU_STREAM, number)
        read = read_ptu(scenario.ptus[name], station, scenario.rig[name], histories[name], span_s, generator)
        for t_s, sample in zip(read.arrival_s, read.samples, strict=True):
            arrivals.append(_Arrival(t_s=float(t_s), rank=_READING, event=sample))
    return arrivals


def _pixels_and_epochs(scenario: Scenario, detections: dict[str, SimulatedDetections]) -> list[_Arrival]:
    """Return the reported pixels, and an epoch for each pair once its last frame is through, seen or not."""
    arrivals = []
    stamps, through = [], []
    for name, seen in detections.items():
        true, stated = scenario.true_rig[name], scenario.rig[name]
        stamp = stated_times(seen.t_s, true.camera_clock, stated.camera_clock)
        arrival = seen.t_s + scenario.cameras[name].latency_s
        stamps.append(stamp)
        through.append(arrival)
        for k in np.flatnonzero(seen.reported).tolist():
            u, v = seen.reported_px[k]
            pixel = PixelMeasurement(t_s=float(stamp[k]), station=name, epoch=k, u_px=float(u), v_px=float(v))
            arrivals.append(_Arrival(t_s=float(arrival[k]), rank=_PIXEL, event=pixel))
    names = tuple(detections)
    for k, (mean, last) in enumerate(zip(np.mean(stamps, axis=0), np.max(through, axis=0), strict=True)):
        epoch = Epoch(t_s=float(mean), epoch=k, stations=names)
        arrivals.append(_Arrival(t_s=float(last), rank=_EPOCH, event=epoch))
    return arrivals


def _truth(scenario: Scenario, detections: dict[str, SimulatedDetections]) -> FlightTruth:
    t_s = np.mean([seen.t_s for seen in detections.values()], axis=0)
    return FlightTruth(
        t_s=t_s,
        position_runway_m=scenario.trajectory.position(t_s),
        velocity_runway_m_s=scenario.trajectory.velocity(t_s),
        stations={
            name: StationTruth(
                t_s=seen.t_s,
                pixel_px=seen.pixel_px,
                visible=seen.visible,
                reported=seen.reported,
                outlier=seen.outlier,
                angles_rad=seen.pointing.head_rad,
                rates_rad_s=seen.pointing.head_rate_rad_s,
            )
            for name, seen in detections.items()
        },
    )
