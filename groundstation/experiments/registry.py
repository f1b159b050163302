"""Every experiment of the papers that the recordings allow, in the papers' order. A new one is one line here."""

from groundstation.experiments import (
    canny,
    delay_compensation,
    detectors,
    leaving_view,
    localisation,
    onboard_edges,
    onboard_energies,
    onboard_flights,
    onboard_passes,
    onboard_pose,
    onboard_segmentation,
    sensitivity,
)
from groundstation.experiments.experiment import Experiment, Paper

EXPERIMENTS: tuple[Experiment, ...] = (
    Experiment(
        name="detectors",
        paper=Paper.GROUND,
        numbers="figures 7 and 9, table 2",
        title="Chan-Vese against snake and GVF snake",
        run=detectors.methods,
    ),
    Experiment(
        name="trajectories",
        paper=Paper.GROUND,
        numbers="figure 8",
        title="Trajectories by GVF, snake and Chan-Vese through one triangulation",
        run=detectors.trajectories,
    ),
    Experiment(
        name="roi",
        paper=Paper.GROUND,
        numbers="figure 10, table 1",
        title="The size of the region of interest",
        run=detectors.roi_sweep,
    ),
    Experiment(
        name="accuracy",
        paper=Paper.GROUND,
        numbers="section 5.1",
        title="The detector by size and background",
        run=detectors.accuracy_by_phase,
    ),
    Experiment(
        name="ekf",
        paper=Paper.GROUND,
        numbers="figure 11, table 3",
        title="EKF against triangulation",
        run=localisation.ekf_against_triangulation,
    ),
    Experiment(
        name="sensitivity",
        paper=Paper.GROUND,
        numbers="figure 12",
        title="What 0 to 50 px of detection error do",
        run=sensitivity.sensitivity,
    ),
    Experiment(
        name="out-of-view",
        paper=Paper.GROUND,
        numbers="figure 13",
        title="Predictions out of the field of view",
        run=leaving_view.leaving,
    ),
    Experiment(
        name="failure",
        paper=Paper.GROUND,
        numbers="table 4",
        title="A stretch in which detection fails",
        run=localisation.failure_stretch,
    ),
    Experiment(
        name="online",
        paper=Paper.GROUND,
        numbers="figure 14, table 5",
        title="On line, 110 ms late",
        run=delay_compensation.online,
    ),
    Experiment(
        name="canny",
        paper=Paper.EDGES,
        numbers="figure 1",
        title="Canny's sensitivity to its σ",
        run=canny.canny,
    ),
    Experiment(
        name="edge-segmentation",
        paper=Paper.EDGES,
        numbers="figures 9 to 11",
        title="Runway edges by the descent alone, and the filter's steps",
        run=onboard_segmentation.segmentation,
    ),
    Experiment(
        name="runway-edges",
        paper=Paper.EDGES,
        numbers="table 1, figures 13 and 14",
        title="Runway edges in four lights",
        run=onboard_edges.edges,
    ),
    Experiment(
        name="edge-energies",
        paper=Paper.EDGES,
        numbers="table 1, figures 9 and 10",
        title="Runway edges without a filter: spatially variant, non-variant, Hough",
        run=onboard_energies.alone,
    ),
    Experiment(
        name="edge-prediction",
        paper=Paper.EDGES,
        numbers="figure 15",
        title="Edges predicted in 3-D and in 2-D",
        run=onboard_edges.prediction,
    ),
    Experiment(
        name="runway-pose",
        paper=Paper.POSE,
        numbers="section 2",
        title="Range from a runway's corners",
        run=onboard_pose.pose_range,
    ),
    Experiment(
        name="inertial",
        paper=Paper.POSE,
        numbers="section 5",
        title="Runway poses and an inertial unit, 20 s without runway",
        run=onboard_pose.inertial,
    ),
    Experiment(
        name="passes",
        paper=Paper.POSE,
        numbers="figures 4 to 7",
        title="Several lengthwise passes over a runway",
        run=onboard_passes.passes,
    ),
    Experiment(
        name="nose-flights",
        paper=Paper.POSE,
        numbers="figures 1 and 4",
        title="From the nose camera's pictures to a trajectory",
        run=onboard_flights.flights,
    ),
)


def named(name: str) -> Experiment:
    """Return the experiment of this name; raises `KeyError`."""
    return {e.name: e for e in EXPERIMENTS}[name]
