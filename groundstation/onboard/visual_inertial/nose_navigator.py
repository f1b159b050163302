"""The nose camera and the inertial unit together: for each picture edges, corners, pose, filter, and fix.

The edge tracker takes an external pose (a navigation log, or visual odometry) as long as there is one: with the
filter's pose, edges and filter would confirm each other. Without one, it uses the filter's, once that is
trusted. Only edges that the tracker itself calls *tracking* go into the filter.
"""

from dataclasses import replace

import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.geometry.camera import Lens
from groundstation.geometry.rotation import matrix_from_wxyz, rotation_from_vector, wxyz_from_matrix
from groundstation.onboard.edges.config import TrackerConfig
from groundstation.onboard.edges.kalman import LineState
from groundstation.onboard.edges.line_state import PITCH, ROLL, UP, C, D
from groundstation.onboard.edges.pose import NoseCameraPose, intrinsic_matrix
from groundstation.onboard.edges.pose_drift import NO_DRIFT, PoseDrift
from groundstation.onboard.edges.report import EdgeReport, Edges, EdgeStatus
from groundstation.onboard.edges.search_band import RunwayGuess
from groundstation.onboard.edges.tracker import EdgeTracker
from groundstation.onboard.pose.inertial_filter import (
    ATTITUDE,
    POSITION,
    VELOCITY,
    CameraMount,
    ImuSample,
    InertialFilter,
    Navigation,
    PoseInnovation,
    PoseObservation,
    UpdateOutcome,
)
from groundstation.onboard.pose.pose_solver import PointCorrespondences, PoseStatus, RunwayPose, solve_pose
from groundstation.onboard.pose.runway import Runway
from groundstation.onboard.visual_inertial.config import ApproachConfig
from groundstation.onboard.visual_inertial.consider_parameters import ConsiderFilterBank
from groundstation.onboard.visual_inertial.corner_errors import edge_mode_count, mode_count, width_mode
from groundstation.onboard.visual_inertial.corner_finder import FoundCorners, NoCorners, find_corners
from groundstation.onboard.visual_inertial.lasting_errors import KnownHeight, LastingErrors
from groundstation.onboard.visual_inertial.nose_report import NoseFix, NoseReport
from groundstation.onboard.visual_inertial.pose_sensitivity import pixel_jacobian_of_pose, pose_jacobian_of_pixels

# largest distance of the edges from their surveyed position when the filter takes over
_START_TURN_RAD = 0.02
_START_SHIFT_M = 1.5
# of a fix's covariance and of the sensitivities: the rotation vector; of a position: up
ATTITUDE_OF_FIX = slice(3, 6)
UPWARDS = 2


class NoseNavigator:
    """Takes inertial samples and pictures without distortion, in order of time.

    Parameters
    ----------
    runway : its surveyed corners.
    lens : of the camera; its distortion is left out, as pictures come without.
    mount : of the camera on the body.
    tracker : tuning for edges by the external poses; the announced runway in it is replaced by ``runway``.
    """

    def __init__(
        self,
        runway: Runway,
        lens: Lens,
        mount: CameraMount,
        config: ApproachConfig | None = None,
        tracker: TrackerConfig | None = None,
    ) -> None:
        self._runway, self._mount = runway, mount
        self._config = config or ApproachConfig()
        self._lens = replace(lens, distortion=np.zeros(5))
        self._kappa = intrinsic_matrix(lens)
        guess = RunwayGuess(width_m=runway.width_m, length_m=runway.length_m)
        by_others = TrackerConfig() if tracker is None else tracker
        self._tracker = EdgeTracker(self._kappa, lens.image_size_px, replace(by_others, guess=guess))
        # by the filter's own poses, whose noise is not that of the external ones
        self._own_config = TrackerConfig(guess=guess)
        self._own_tracker: EdgeTracker | None = None
        self._inside = self._confirmed = False
        self._used = 0
        self._in_a_row = 0
        self._scatter = 1.0
        self._last: ImuSample | None = None
        self._height: KnownHeight | None = None
        self._begin()

    def _begin(self) -> None:
        """Make the filters new; the next pose starts them."""
        self._filter = InertialFilter(self._config.inertial, self._mount)
        self._edge_modes = edge_mode_count(self._config.corners)
        # the edges' again as waves, and the runway's width
        count = mode_count(self._config.corners) + 2 * self._edge_modes + 1
        self._lasting = ConsiderFilterBank(self._config.inertial, self._mount, count)
        self._errors = LastingErrors(count, self._config.height_memory_s)
        self._used = self._refused = 0
        self._confirmed = False
        self._scatter = 1.0
        if self._last is not None:
            self.process_imu(self._last)

    @property
    def runway(self) -> Runway:
        """Return the runway that it was made for."""
        return self._runway

    @property
    def needs_no_external_pose(self) -> bool:
        """Return whether it needs no pose from outside any more."""
        return self._inside

    def process_imu(self, sample: ImuSample) -> None:
        """Take an inertial sample."""
        self._filter.process_imu(sample)
        self._lasting.process_imu(sample)
        self._last = sample

    def update(
        self,
        t_s: float,
        image: ImageArray,
        outside: NoseCameraPose | None,
        height: KnownHeight | None = None,
        drift: PoseDrift = NO_DRIFT,
    ) -> NoseReport:
        """Take a picture (h, w, 3) uint8 BGR, with a pose from outside and a known height as far as there are any.

        ``drift`` : what the pose from outside is wrong by besides the tracker's tuning.
        """
        self._height = height
        if self._last is not None and t_s > self._last.t_s:
            # the sample before holds until the next: the state is brought to the picture's time
            self.process_imu(replace(self._last, t_s=t_s))
        tracker_pose = self._choose_tracker_pose(outside)
        if tracker_pose is None:
            return self._report(t_s, None, None, None, None, None)
        own_tracker = self._own_tracker
        edges = own_tracker.step(image, tracker_pose) if own_tracker else self._tracker.step(image, tracker_pose, drift)
        tracked = edges.status is EdgeStatus.TRACKING
        self._in_a_row = self._in_a_row + 1 if tracked else 0
        if edges.edges is None or edges.edges.measured_px is None:
            return self._report(t_s, tracker_pose, edges, None, None, None)
        if not tracked or not self._settled(edges.edges):
            report = self._report(t_s, tracker_pose, edges, None, None, None)
            return replace(report, other_width_m=None if self._as_wide(edges.edges) else _apart_m(edges.edges))
        own = self._own() if self._inside else None
        corners = find_corners(
            image, edges.edges, own or tracker_pose, self._runway, self._kappa, self._config,
            None if own is None else self._row_sigmas(own),
        )  # fmt: skip
        if isinstance(corners, NoCorners):
            return self._report(t_s, tracker_pose, edges, corners, None, None)
        pose = self._solve(corners)
        innovation = None
        if pose is not None and pose.status is PoseStatus.OK:
            innovation = self._correct(t_s, corners, pose)
        return self._report(t_s, tracker_pose, edges, corners, pose, innovation)

    def _choose_tracker_pose(self, outside: NoseCameraPose | None) -> NoseCameraPose | None:
        """Return the pose for the tracker: the external one as long as it exists, to avoid feedback.

        By the filter's poses another tracker follows them, which starts at the surveyed edges.
        """
        if not self._inside and self._trusted():
            self._inside = True
        if outside is not None or not self._inside:
            self._own_tracker = None
            return outside
        own = self._own()
        if own is not None and self._own_tracker is None:
            self._own_tracker = EdgeTracker(self._kappa, self._lens.image_size_px, self._own_config)
            self._own_tracker.start(self._surveyed())
        return own

    def _own(self) -> NoseCameraPose | None:
        """Return where the filter puts the camera; None below the ground."""
        position, wxyz = self._filter.camera_pose()
        if position[2] <= 0.0:
            return None
        return NoseCameraPose(threshold_from_camera=matrix_from_wxyz(wxyz), camera_threshold_m=position)

    def _surveyed(self) -> LineState:
        """Return the edges by the survey: in the filter's own frame they are there, within its errors."""
        tracker, half = self._own_config, 0.5 * self._runway.width_m
        covariance = np.zeros((7, 7))
        covariance[1, 1] = _START_TURN_RAD**2
        covariance[C, C] = covariance[D, D] = _START_SHIFT_M**2
        covariance[ROLL, ROLL] = covariance[PITCH, PITCH] = tracker.lasting_attitude_rad**2
        covariance[UP, UP] = tracker.lasting_height_m**2
        return LineState(mean=np.array([1.0, 0.0, -half, half, 0.0, 0.0, 0.0]), covariance=covariance)

    def _row_sigmas(self, predicted: NoseCameraPose) -> FloatArray | None:
        """Return sigmas (2,) px of the predicted rows of the thresholds; None while the filter is not trusted."""
        H = None
        if self._inside:
            H = pixel_jacobian_of_pose(
                self._runway.corners_m, self._kappa, predicted.camera_threshold_m, predicted.threshold_from_camera
            )
        if H is None:
            return None
        S = self._sensitivity_of_fix()
        P = (self._covariance(self._filter.navigation) + S @ S.T)[:6, :6]
        rows = np.sqrt(np.einsum("ij,jk,ik->i", H[1::2], P, H[1::2]))
        return np.array([max(rows[0], rows[3]), max(rows[1], rows[2])])

    def _settled(self, edges: Edges) -> bool:
        """Return whether the edges may start a filter, or continue one that is trusted."""
        return self._as_wide(edges) and (self._inside or self._in_a_row > self._config.settled_after)

    def _as_wide(self, edges: Edges) -> bool:
        """Return whether edges are about as far apart as the runway is wide."""
        return abs(_apart_m(edges) / self._runway.width_m - 1.0) < self._config.width_share

    def _trusted(self) -> bool:
        config, now = self._config, self._filter.navigation
        if self._used < config.trusted_after:
            return False
        sigma = np.sqrt(np.diag(now.P))
        far = float(np.linalg.norm(now.position_m))
        return bool(
            sigma[ATTITUDE].max() < config.trusted_attitude_rad
            and np.linalg.norm(sigma[POSITION]) < config.trusted_share * far
        )

    def _solve(self, corners: FoundCorners) -> RunwayPose | None:
        """Return the pose of corners, each weighed by all that it may be wrong by."""
        try:
            return solve_pose(
                PointCorrespondences(
                    points_m=self._runway.corners_m,
                    pixels=corners.pixels,
                    covariance_px2=corners.whole_covariance_px2,
                    lens=self._lens,
                )
            )
        except ValueError:
            return None

    def _correct(self, t_s: float, corners: FoundCorners, pose: RunwayPose) -> PoseInnovation | None:
        """Hand the pose to the filter with the part of its covariance that each picture has again; keep the rest."""
        independent = self._scatter * corners.covariance_px2
        D = self._sensitivity(pose, corners)
        if D is None:
            return None
        covariance = sum(
            (D[:, 2 * k : 2 * k + 2] @ independent[k] @ D[:, 2 * k : 2 * k + 2].T for k in range(4)), np.zeros(1)
        )
        lasting = D @ self._in_time(t_s, corners)
        observation = PoseObservation(
            t_s=t_s,
            position_m=pose.position_m,
            runway_from_camera_wxyz=pose.runway_from_camera_wxyz,
            covariance=np.asarray(covariance),
            lasting=lasting @ lasting.T,
        )
        innovation = self._filter.update(observation)
        self._lasting.update(observation, lasting)
        self._learn_scatter(innovation, observation)
        if innovation.outcome in (UpdateOutcome.USED, UpdateOutcome.STARTED, UpdateOutcome.RESTARTED):
            self._used += 1
            self._confirmed = self._confirmed or self._used >= self._config.confirmed_after
        self._refused = self._refused + 1 if innovation.outcome is UpdateOutcome.GATED else 0
        if not self._inside and self._refused >= self._config.give_up_after:
            self._begin()
        if innovation.outcome is UpdateOutcome.RESTARTED:
            # its velocity is unknown again: the tracker returns to the external pose
            self._used, self._inside, self._confirmed = 1, False, False
            self._errors.restart()
        return innovation

    def _in_time(self, t_s: float, corners: FoundCorners) -> FloatArray:
        """Return the constant errors, the edges' part that varies within the flight (two phases of a wave), the width.

        A constant error of an edge may cancel in the state; one that is there for some seconds does not.
        """
        config, edges = self._config, corners.systematic_px[:, : self._edge_modes]
        angle = 2.0 * np.pi * t_s / config.changing_s
        waves = [config.changing_share * float(wave) * edges for wave in (np.cos(angle), np.sin(angle))]
        width = width_mode(corners.pixels, config.width_sigma)
        return np.hstack([corners.systematic_px, *waves, width[:, None]])

    def _learn_scatter(self, innovation: PoseInnovation, observation: PoseObservation) -> None:
        """Adapt the covariance of each picture to the innovations, never below that of the fits."""
        if innovation.outcome not in (UpdateOutcome.USED, UpdateOutcome.GATED) or observation.lasting is None:
            return
        value = innovation.value
        share = float(value @ np.linalg.solve(innovation.covariance - observation.lasting, value)) / value.size
        step = self._config.scatter_share * (min(share, self._config.most_share) - 1.0)
        self._scatter = float(np.clip(self._scatter * (1.0 + step), 1.0, self._config.most_scatter))

    def _sensitivity(self, pose: RunwayPose, corners: FoundCorners) -> FloatArray | None:
        """Return how the pose moves with its pixels; at the filter's pose where that has the smaller covariance."""
        weights = corners.whole_covariance_px2
        position, wxyz = pose.position_m, pose.runway_from_camera_wxyz
        if self._filter.started:
            P = self._filter.navigation.P
            ours = np.trace(P[POSITION, POSITION]) + pose.range_m**2 * np.trace(P[ATTITUDE, ATTITUDE])
            theirs = np.trace(pose.covariance[:3, :3]) + pose.range_m**2 * np.trace(pose.covariance[3:, 3:])
            if ours <= theirs:
                position, wxyz = self._filter.camera_pose()
        return pose_jacobian_of_pixels(self._runway.corners_m, self._kappa, position, matrix_from_wxyz(wxyz), weights)

    def _fix(self, t_s: float) -> NoseFix:
        """Return the camera's place with the whole covariance, less what lasts as far as that has been learnt."""
        now, S = self._filter.navigation, self._sensitivity_of_fix()
        off, covariance = self._errors.corrected(t_s, S, self._covariance(now), UPWARDS)
        turned = rotation_from_vector(-off[ATTITUDE_OF_FIX]) @ matrix_from_wxyz(now.runway_from_body_wxyz)
        return NoseFix(
            t_s=t_s,
            position_m=self._filter.camera_pose()[0] - off[:3],
            velocity_m_s=now.velocity_m_s - off[6:],
            runway_from_body_wxyz=wxyz_from_matrix(turned),
            covariance=covariance,
            status=now.status,
        )

    def _arm(self, now: Navigation) -> FloatArray:
        """Return how the camera's place moves with the body's rotation vector, (3, 3)."""
        x, y, z = matrix_from_wxyz(now.runway_from_body_wxyz) @ self._mount.camera_in_body_m
        return np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])

    def _covariance(self, now: Navigation) -> FloatArray:
        """Return the filter's own covariance of the camera's place, attitude and velocity, (9, 9)."""
        G = np.zeros((9, now.P.shape[0]))
        G[:3, POSITION] = G[ATTITUDE_OF_FIX, ATTITUDE] = G[6:, VELOCITY] = np.eye(3)
        G[:3, ATTITUDE] = self._arm(now)
        return np.asarray(G @ now.P @ G.T)

    def _sensitivity_of_fix(self) -> FloatArray:
        """Return what one sigma of each lasting error makes of the camera's place, attitude and velocity, (9, n)."""
        now = self._filter.navigation
        S = self._lasting.sensitivity(now)
        S[:3] += self._arm(now) @ S[ATTITUDE_OF_FIX]
        return S

    def _report(
        self,
        t_s: float,
        tracker_pose: NoseCameraPose | None,
        edges: EdgeReport | None,
        corners: FoundCorners | NoCorners | None,
        pose: RunwayPose | None,
        innovation: PoseInnovation | None,
    ) -> NoseReport:
        """Return what came of a picture, with the fix after it and after what is known of the height."""
        if self._confirmed and self._height is not None:
            S, P = self._sensitivity_of_fix(), self._covariance(self._filter.navigation)
            off_m = float(self._filter.camera_pose()[0][UPWARDS]) - self._height.up_m
            self._errors.update(t_s, off_m, S[UPWARDS], float(P[UPWARDS, UPWARDS]), self._height)
        fix = self._fix(t_s) if self._confirmed else None
        return NoseReport(
            t_s=t_s, tracker_pose=tracker_pose, edges=edges, corners=corners, pose=pose, innovation=innovation, fix=fix
        )


def _apart_m(edges: Edges) -> float:
    """Return how far edges are apart on the ground."""
    return abs(float(edges.state.mean[C] - edges.state.mean[D]))
