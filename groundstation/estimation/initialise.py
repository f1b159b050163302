"""Track initiation: from candidates in single images to a confirmed 3-D track.

Candidates of two cameras are associated if their rays intersect within their noise, in front of the cameras and above
ground, and if their widths correspond to an aircraft at that distance. These fixes are linked over time by
constant-velocity filters; a tentative track with enough hits and a significant velocity is confirmed. Trees, runway
markings and false associations of them are stationary or jump.

Candidates that the learned channel has weighed bring their log odds of aircraft. A track that it recognises in both
cameras, fix after fix, is confirmed without motion: an aircraft that stands before its take-off. One that it does not
recognise, a bird or an aircraft unlike those of its training, must move for longer.
"""

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.estimation.camera_candidate import CameraCandidate
from groundstation.estimation.config import InitiationConfig
from groundstation.estimation.initial_fix import Fix, without_false_pairs, without_lesser
from groundstation.estimation.tentative_track import (
    InitiatedTarget,
    TentativeTrack,
    initiated,
    motion_over,
    without_copies,
)
from groundstation.estimation.triangulation import TriangulationView, triangulate
from groundstation.geometry.station import LensError, StationGeometry
from groundstation.messages import InitialPixel, Kinematics

# a target's depth is its distance but for the angle off the optical axis
_SIZE_SLACK = 1.2
# 0.999 quantile of chi-square with 3 degrees of freedom: the gate that links a fix to a track
_LINK_GATE = 16.27
# log odds of aircraft beyond which a fix is no more likely to be that of a track: those of the channel are no true
# probabilities, and a young track, whose velocity is unknown, would reach out for them (train world 493, limit of 12)
_LINK_ODDS = 1.0
# a fix that is likelier an aircraft by more than this, up to what is sure, starts a track of its own
_LESS_LIKELY, _SURE_ODDS = 1.5, 3.0
_MAX_TRACKS = 40
# an age of three frame intervals is one of three frames, whatever their stamps' last digit
_ROUNDING_S = 1e-3


class TrackInitiator:
    """Links the candidates of successive epochs and confirms a target."""

    def __init__(self, stations: Mapping[str, StationGeometry], config: InitiationConfig, span_m: float | None) -> None:
        self._stations = stations
        self._config = config
        self._span_m = span_m
        self._tracks: list[TentativeTrack] = []
        self._weighed = False

    @property
    def promising(self) -> bool:
        """Whether a tentative track has at least three hits and at most one recent miss."""
        return any(t.hits >= 3 and t.misses <= 1 for t in self._tracks)

    def reset(self) -> None:
        """Discard all tentative tracks."""
        self._tracks.clear()

    def step(
        self, t_s: float, sightings: Sequence[CameraCandidate], known: Kinematics | None = None
    ) -> tuple[InitiatedTarget, ...]:
        """Process the candidates of one epoch; return the targets at ``t_s`` that are confirmed, best first.

        What is recognised comes before what only moves, then the likelier aircraft, then the higher score. ``known`` is
        a target at ``t_s`` that is tracked already: what is where it is, is not returned.
        """
        self._weighed |= any(s.odds is not None for s in sightings)
        fixes = self.fixes(sightings)
        self._predict(t_s)
        self._link(fixes, t_s)
        self._tracks = [t for t in self._tracks if t.misses <= self._config.max_misses]
        others = [t for t in self._tracks if known is None or not _is_at(t, known)]
        brightest = max((t.score / t.hits for t in others if t.hits >= 3 and self._may_outshine(t)), default=0.0)
        confirmed = []
        for track in others:
            recognised = self._is_recognised(track)
            # a clearer track says nothing against one that is recognised
            moving = self._is_moving(track, 0.0 if recognised else brightest)
            if moving or recognised:
                odds = min(track.mean_odds or 0.0, _SURE_ODDS)
                rank = 2 * recognised + moving, odds, track.score / track.hits
                confirmed.append((rank, initiated(track, self._config, moving=moving, recognised=recognised)))
        return tuple(target for _, target in sorted(confirmed, key=lambda each: each[0], reverse=True))

    def discard(self, known: Kinematics) -> None:
        """Discard the tentative tracks at a target's place: it was given up as a false track."""
        self._tracks = [t for t in self._tracks if not _is_at(t, known)]

    def _may_outshine(self, track: TentativeTrack) -> bool:
        """Return whether the scores of others are compared with a track's: not if the learned channel doubts it."""
        return track.mean_odds is None or track.mean_odds >= self._config.recognised_odds

    def fixes(self, sightings: Sequence[CameraCandidate]) -> list[Fix]:
        """Return the plausible fixes among candidates of different stations, best first."""
        by_station: dict[str, list[CameraCandidate]] = {}
        for s in sightings:
            by_station.setdefault(s.station, []).append(s)
        found = []
        for a, b in combinations(by_station, 2):
            for first, second, ranges_m in self._nearly_meeting(by_station[a], by_station[b]):
                fix = self._fix(first, second, ranges_m)
                if fix is not None:
                    found.append(fix)
        return sorted(without_lesser(without_false_pairs(found)), key=lambda f: -f.score)

    def _nearly_meeting(
        self, first: list[CameraCandidate], second: list[CameraCandidate]
    ) -> list[tuple[CameraCandidate, CameraCandidate, tuple[float, float]]]:
        """Return pairs whose rays nearly intersect, and how far away: a fast test before the triangulation.

        The two ranges differ where one camera is far down the runway.
        """
        first, one = self._rays(first)
        second, two = self._rays(second)
        if not first or not second:
            return []
        # origins and directions (n, 1, 3) against (1, m, 3): all pairs at once
        apart = two[None, :, 0] - one[:, None, 0]
        normal = np.cross(one[:, None, 1], two[None, :, 1])
        sine = np.maximum(np.linalg.norm(normal, axis=2), 1e-12)
        gap = np.abs((apart * normal).sum(axis=2)) / sine
        ahead = sine >= 1e-5
        ranges = np.empty((*sine.shape, 2))
        for k, other in enumerate((two[None, :, 1], one[:, None, 1])):
            ranges[:, :, k] = (np.cross(apart, other) * normal).sum(axis=2) / sine**2
            ahead &= (ranges[:, :, k] >= self._config.min_range_m) & (ranges[:, :, k] <= self._config.max_range_m)
        pairs = []
        for i, j in np.argwhere(ahead):
            near, far = (float(r) for r in ranges[i, j])
            if not self._sizes_possible(first[i], second[j], (near, far)):
                continue
            noise_m = near * self._ray_sigma(first[i], near) + far * self._ray_sigma(second[j], far)
            if gap[i, j] <= (self._config.residual_gate_sigma + 1.0) * noise_m:
                pairs.append((first[i], second[j], (near, far)))
        return pairs

    def _rays(self, sightings: list[CameraCandidate]) -> tuple[list[CameraCandidate], FloatArray]:
        """Return the candidates whose pixel has a ray, and origin and direction of each, (n, 2, 3)."""
        seen, rays = [], []
        for s in sightings:
            try:
                ray = self._stations[s.station].ray(s.pixel[0], s.pixel[1], s.pan_rad, s.tilt_rad)
            except LensError:
                continue
            seen.append(s)
            rays.append((ray.origin_runway_m, ray.direction_runway))
        return seen, np.array(rays)

    def _ray_sigma(self, s: CameraCandidate, distance_m: float) -> float:
        focal = float(self._stations[s.station].lens.focal_px.mean())
        return float(np.hypot(self._sigma_px(s, distance_m) / focal, s.angle_sigma_rad))

    def _sigma_px(self, s: CameraCandidate, distance_m: float) -> float:
        """Return the noise of a candidate's point; that of a moving one may be of any part of the aircraft."""
        if s.sigma_px is not None:
            return float(np.hypot(self._config.candidate_sigma_px, s.sigma_px))
        if s.moving:
            span_m = self._config.usual_span_m if self._span_m is None else self._span_m
            whole_px = span_m * float(self._stations[s.station].lens.focal_px[0]) / distance_m
            return float(np.hypot(self._config.candidate_sigma_px, self._config.moving_sigma_share * whole_px))
        share = 0.0 if s.width_px is None else self._config.candidate_sigma_share * s.width_px
        return float(np.hypot(self._config.candidate_sigma_px, share))

    def _fix(self, first: CameraCandidate, second: CameraCandidate, ranges_m: tuple[float, float]) -> Fix | None:
        """Return the fix of two candidates, at about these ranges, if it is plausible for an aircraft."""
        views = [
            TriangulationView(
                station=self._stations[s.station],
                pixel=s.pixel,
                covariance_px2=np.eye(2) * self._sigma_px(s, range_m) ** 2,
                pan_rad=s.pan_rad,
                tilt_rad=s.tilt_rad,
                angle_sigma_rad=s.angle_sigma_rad,
            )
            for s, range_m in zip((first, second), ranges_m, strict=True)
        ]
        point = triangulate(views)
        if point is None or point.residual_sigma > self._config.residual_gate_sigma:
            return None
        z = float(point.point_runway_m[2])
        sigma_z = float(np.sqrt(point.covariance_m2[2, 2]))
        if not self._config.min_height_m - 3 * sigma_z <= z <= self._config.max_height_m:
            return None
        widths_m = self._widths_m(first, second, point.point_runway_m)
        if widths_m is None or not (widths_m == [] or self._width_believable(widths_m, (first, second), 1.0)):
            return None
        return Fix(
            position_m=point.point_runway_m,
            covariance_m2=point.covariance_m2,
            score=min(first.score, second.score),
            labelled=first.labelled and second.labelled,
            odds=None if first.odds is None or second.odds is None else min(first.odds, second.odds),
            pixels=tuple(
                InitialPixel(
                    t_s=s.t_s,
                    station=s.station,
                    u_px=float(s.pixel[0]),
                    v_px=float(s.pixel[1]),
                    sigma_px=self._sigma_px(s, range_m),
                )
                for s, range_m in zip((first, second), ranges_m, strict=True)
                if not s.labelled
            ),
            narrow=min(widths_m, default=np.inf) < self._width_limits_m[0],
        )

    def _sizes_possible(self, first: CameraCandidate, second: CameraCandidate, ranges_m: tuple[float, float]) -> bool:
        """Return whether widths are believable at about these ranges, to avoid needless triangulations."""
        if first.width_px is None or second.width_px is None:
            return True
        widths = [
            s.width_px * range_m / float(self._stations[s.station].lens.focal_px[0])
            for s, range_m in zip((first, second), ranges_m, strict=True)
            if s.width_px is not None
        ]
        return self._width_believable(widths, (first, second), _SIZE_SLACK)

    def _widths_m(self, first: CameraCandidate, second: CameraCandidate, point: FloatArray) -> list[float] | None:
        """Return the widths of two silhouettes at a point, m, none where one is unknown; None behind a camera."""
        widths = []
        for s in (first, second):
            if s.width_px is None:
                return []
            projection = self._stations[s.station].project(point, s.pan_rad, s.tilt_rad)
            if projection is None:
                return None
            widths.append(s.width_px * projection.depth_m / float(self._stations[s.station].lens.focal_px[0]))
        return widths

    @property
    def _width_limits_m(self) -> tuple[float, float]:
        """The least and the largest plausible width, m."""
        c = self._config
        if self._span_m is None:
            return c.min_size_m, c.max_size_m
        return self._span_m / c.size_tolerance, self._span_m * c.size_tolerance

    def _width_believable(
        self, widths_m: list[float], seen: tuple[CameraCandidate, CameraCandidate], slack: float
    ) -> bool:
        """Return whether two widths in m agree and are plausible for an aircraft, to a factor of ``slack``."""
        partial = any(s.moving for s in seen)
        if not partial and max(widths_m) > slack * self._config.size_agreement * min(widths_m):
            return False
        low, high = self._width_limits_m
        if all(s.odds is not None and s.odds > 0.0 for s in seen):
            # both cameras may show the fuselage alone
            low = min(low, self._config.min_size_m)
        return (partial or low <= slack * min(widths_m)) and max(widths_m) <= slack * high

    def _predict(self, t_s: float) -> None:
        """Predict all tentative tracks to ``t_s``; tracks started later are left unchanged."""
        motions: dict[float, tuple[FloatArray, FloatArray]] = {}
        for track in self._tracks:
            dt = t_s - track.t_s
            if dt <= 0.0:
                continue
            if dt not in motions:
                motions[dt] = motion_over(dt, self._config.acceleration_psd_m2_s3)
            F, Q = motions[dt]
            track.x = F @ track.x
            track.P = F @ track.P @ F.T + Q
            track.t_s = t_s

    def _link(self, fixes: list[Fix], t_s: float) -> None:
        """Associate each track with its most likely fix; fixes that are of no likely track start new ones.

        Several tracks may have one fix: a false track that reaches out for it takes it from none. Those that come to
        the same state are one.

        Of fixes that are about as near the one counts that the channel takes for an aircraft: features of the ground
        next to an aircraft are as near to its track as the aircraft.
        """
        chosen_by: dict[int, list[TentativeTrack]] = {}
        for track in self._tracks:
            squares = np.array([track.distance(f.position_m, f.covariance_m2) for f in fixes])
            costs = squares - 2.0 * np.clip([f.odds or 0.0 for f in fixes], -_LINK_ODDS, _LINK_ODDS)
            costs = np.where(squares < _LINK_GATE, costs, np.inf)
            if np.isfinite(costs).any():
                best = int(np.argmin(costs))
                track.squares += float(squares[best])
                fix = fixes[best]
                track.update(fix.position_m, fix.covariance_m2, fix.score, labelled=fix.labelled)
                track.add_odds(fix.odds, self._config.hits)
                track.pixels.extend(fix.pixels)
                chosen_by.setdefault(best, []).append(track)
            else:
                track.misses += 1
        self._tracks = without_copies(self._tracks)
        free = [f for k, f in enumerate(fixes) if not _is_explained(f, chosen_by.get(k, ()))]
        for fix in free[: _MAX_TRACKS - len(self._tracks)]:
            P = np.zeros((6, 6))
            P[:3, :3] = fix.covariance_m2
            P[3:, 3:] = np.eye(3) * (self._config.max_speed_m_s / 3.0) ** 2
            x = np.concatenate([fix.position_m, np.zeros(3)])
            track = TentativeTrack(
                t_s=t_s,
                born_s=t_s,
                x=x,
                P=P,
                newest_covariance_m2=fix.covariance_m2,
                score=fix.score,
                labelled=fix.labelled,
            )
            track.add_odds(fix.odds, self._config.hits)
            track.pixels.extend(fix.pixels)
            self._tracks.append(track)

    def _is_recognised(self, track: TentativeTrack) -> bool:
        """Return whether the learned channel has taken a track for an aircraft, in both cameras and for some time."""
        c, odds = self._config, track.mean_odds
        if odds is None or odds < c.recognised_odds or not self._is_persistent(track, c.recognised_hits):
            return False
        return track.squares / (track.hits - 1) <= c.max_link_square

    def _is_persistent(self, track: TentativeTrack, hits: int) -> bool:
        """Return whether a track has so many hits, the newest now, and is old enough and no faster than aircraft."""
        c = self._config
        if track.hits < hits or track.misses > 0 or track.t_s - track.born_s < c.min_age_s - _ROUNDING_S:
            return False
        return float(np.linalg.norm(track.x[3:])) <= c.max_speed_m_s

    def _is_moving(self, track: TentativeTrack, brightest: float) -> bool:
        """Return whether a track is confirmed by low residuals, high scores and a significant velocity."""
        c = self._config
        if not self._is_persistent(track, c.hits):
            return False
        if track.labelled:
            return True
        # what the channel had no time to look at, as others stood out more, is no likely aircraft either
        unweighed = self._weighed and track.mean_odds is None
        if track.t_s - track.born_s < (c.unlikely_age_s if unweighed else c.moving_age_s(track.mean_odds)):
            return False
        mean_square = track.squares / (track.hits - 1)
        if mean_square > c.max_link_square or track.score / track.hits < c.min_relative_score * brightest:
            return False
        # the noise of the fixes is estimated from their residuals
        noise_scale = max(mean_square / 3.0, c.min_noise_scale if track.hits >= c.scale_hits else 1.0)
        significance = float(np.sqrt(track.x[3:] @ np.linalg.solve(track.P[3:, 3:], track.x[3:]) / noise_scale))
        return float(np.linalg.norm(track.x[3:])) >= c.min_speed_m_s and significance >= c.motion_sigma


def _is_explained(fix: Fix, tracks: Sequence[TentativeTrack]) -> bool:
    """Return whether one of the tracks that have taken a fix is about as likely an aircraft as the fix is."""
    odds = min(fix.odds or 0.0, _SURE_ODDS)
    return any(odds - (track.mean_odds or 0.0) <= _LESS_LIKELY for track in tracks)


def _is_at(track: TentativeTrack, known: Kinematics) -> bool:
    """Return whether a tentative track may be the target that is tracked already."""
    spread = track.newest_covariance_m2 + known.covariance[:3, :3]
    return track.distance(known.position_runway_m, spread) < _LINK_GATE
