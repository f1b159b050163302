"""What comes of a picture on the way to a trajectory, and the fix at its end."""

from collections.abc import Mapping
from dataclasses import dataclass

from groundstation.arrays import FloatArray
from groundstation.onboard.edges.pose import NoseCameraPose
from groundstation.onboard.edges.report import EdgeMiss, EdgeReport, EdgeStatus
from groundstation.onboard.pose.inertial_filter import NavigationStatus, PoseInnovation
from groundstation.onboard.pose.pose_solver import RunwayPose
from groundstation.onboard.visual_inertial.corner_finder import FoundCorners, NoCorners

NOT_TRACKED = "not like the announced runway, or still compared with other lines"
OTHER_WIDTH = "not as far apart as the runway is wide"
# why a picture gave no edges of its own
MISSES: Mapping[EdgeMiss, str] = {
    EdgeMiss.NONE: "",
    EdgeMiss.NO_BAND: "the runway not in the picture by its pose",
    EdgeMiss.NO_PAIR: "no pair of lines like the runway",
    EdgeMiss.FAINT: "edges too faint",
    EdgeMiss.GATED: "edges that do not fit the prediction",
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NoseFix:
    """Pose and velocity of the camera: runway frame.

    Attributes
    ----------
    position_m, velocity_m_s : (3,) of the camera; the velocity is the body's.
    runway_from_body_wxyz : (4,).
    covariance : (9, 9) of position (m), rotation vector (rad, R_true = exp([δθ]×) R) and velocity (m/s): that of the
        filter relative to the visible runway, and the constant distance between the visible edges and the pavement's.
    status : of the filter.
    """

    t_s: float
    position_m: FloatArray
    velocity_m_s: FloatArray
    runway_from_body_wxyz: FloatArray
    covariance: FloatArray
    status: NavigationStatus


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NoseReport:
    """Results of a picture; each part is None where the one before gave nothing for it.

    ``tracker_pose`` is the edge tracker's input, ``edges`` its report; ``corners``, ``pose`` and ``innovation``
    follow; ``fix`` is None until poses confirm the filter's start. ``other_width_m`` is how far the edges are apart
    where that is not the runway's width, None else.
    """

    t_s: float
    tracker_pose: NoseCameraPose | None
    edges: EdgeReport | None
    corners: FoundCorners | NoCorners | None
    pose: RunwayPose | None
    innovation: PoseInnovation | None
    fix: NoseFix | None
    other_width_m: float | None = None

    @property
    def detail(self) -> str:
        """Return in words what failed where edges were missing or not used; empty for other outcomes."""
        if self.outcome not in ("no_edges", "edges_alone") or self.edges is None:
            return ""
        if self.other_width_m is not None:
            return OTHER_WIDTH
        miss = MISSES[self.edges.miss]
        if miss or self.edges.edges is None:
            return miss or "none yet"
        return "followed too briefly" if self.edges.status is EdgeStatus.TRACKING else NOT_TRACKED

    @property
    def outcome(self) -> str:
        """Return in one word the result of the picture: the filter's outcome, or the missing part."""
        if self.tracker_pose is None:
            return "no_pose"
        if self.edges is None or self.edges.edges is None:
            return "no_edges"
        if self.corners is None or isinstance(self.corners, NoCorners):
            return "edges_alone" if self.corners is None else self.corners.value
        if self.innovation is None:
            return "no_fit"
        return self.innovation.outcome.value
