"""Head angles from a picture of the night sky: pan and tilt at which the catalogue's stars are where they are seen.

As `groundstation.registration.head_registration` does it with the ground: the head's calibration is held, pan and tilt
are free. Stars are identified about where the encoders' angles expect them, by the shift that most of them share; where
that fails, by the solver of the calibration. Where stars are too few, or do not fit, it says so.
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime

import cv2
import numpy as np
from scipy.spatial import KDTree

from calibration.stars.identified_stars import expected_pixels
from calibration.stars.sky import FIRST_UTC_S, LAST_UTC_S, ObservingSite, SkyOverSite, decimal_year
from calibration.stars.star_images import StarImages, find_stars
from calibration.stars.star_solver import CatalogueStars, StarSolver, match_stars
from groundstation.arrays import FloatArray, ImageArray, IntArray
from groundstation.errors import InputError
from groundstation.geometry.rolling_shutter import row_delay_s
from groundstation.registration.head_registration import STANDING, RegisteredAngles, RegistrationFault
from groundstation.rig.rig import Rig, Station
from groundstation.session import Session
from groundstation.session.folder import GeoOrigin
from groundstation.session.site_air import SiteAir

_LEAST_STARS = 5
# stars of chance among n matches: so many times their expected number are needed, as in `identified_stars`
_CHANCE_FACTOR = 5.0
# of the search about the encoders' angles, and how near to a common shift a star is: a turn of the picture remains
_SEARCH_SIGMAS, _SHIFT_PX = 4.0, 5.0
# what refraction and the lens leave about angles that are right
_NEAR_PX = 4.0
_ROUNDS, _STEP_RAD = 8, 1e-5
_OUTLIER_SIGMAS, _LEAST_INLIERS = 4.0, 0.6
# blends of stars, and what a calibrated lens leaves; the worst misfits raise the sigma
_MODEL_SIGMA_PX, _LEAST_SIGMA_PX = 0.03, 0.01
# of this height of the Sun no star is seen that a picture would have
_DAYLIGHT = float(np.sin(np.radians(-3.0)))
_SUN_EVERY_S = 60.0
# in operation: as good as by all dots, in half the time, and bounded over a town's lights
_MOST_IN_OPERATION = 20
_REHEARSALS = 3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Matched:
    """Stars (n,) of a picture: their pixels and sigmas, and the directions (n, 3) of the catalogue's.

    ``delay_s`` (n,) after the stamp their rows are exposed.
    """

    pixel_px: FloatArray
    sigma_px: FloatArray
    towards: FloatArray
    delay_s: FloatArray


class StarAngles:
    """Registers the frames of one station to the stars.

    Parameters
    ----------
    station : calibrated, with its lens. sky : over its site. solver : of its lens.
    zero_utc_s : Unix time of session time 0.
    in_operation : within bounded time: the brightest dots alone, and no solver for what the encoders do not expect.
    """

    def __init__(
        self, station: Station, sky: SkyOverSite, solver: StarSolver, zero_utc_s: float, *, in_operation: bool = False
    ) -> None:
        self._station, self._sky, self._solver, self._zero_utc_s = station, sky, solver, zero_utc_s
        self._bounded = in_operation
        self._seconds: float | None = None

    @property
    def seconds(self) -> float:
        """What a frame takes of a processor here, measured once with a drawn picture, which also warms up.

        Of the whole process: dots are found in a thread of the library's own.
        """
        if self._seconds is None:
            image, took = _rehearsed_picture(self._station.lens.image_size_px), []
            for _ in range(_REHEARSALS):
                began_s = time.process_time()
                self._register(image, self._zero_utc_s, np.zeros(2), np.radians(0.01), np.zeros(2))
                took.append(time.process_time() - began_s)
            self._seconds = min(took)
        return self._seconds

    def searches(self, sigma_rad: float) -> bool:
        """Return False: a frame with poor angles takes no longer."""
        return False

    def register_at(
        self,
        image: ImageArray,
        t_s: float,
        pan_rad: float,
        tilt_rad: float,
        sigma_rad: float,
        rates_rad_s: tuple[float, float] = STANDING,
    ) -> RegisteredAngles | RegistrationFault:
        """Return the angles of a frame of session time ``t_s`` whose encoders read so; or why there are none.

        ``rates_rad_s`` of pan and tilt as `groundstation.registration.head_registration.HeadRegistration.register`.
        """
        utc_s = self._zero_utc_s + t_s
        if not FIRST_UTC_S < utc_s < LAST_UTC_S:
            return RegistrationFault.NO_PLACES
        if self._sky.body("sun", round(utc_s / _SUN_EVERY_S) * _SUN_EVERY_S)[2] > _DAYLIGHT:
            return RegistrationFault.DAYLIGHT
        return self._register(image, utc_s, np.array([pan_rad, tilt_rad]), sigma_rad, np.array(rates_rad_s))

    def _register(
        self, image: ImageArray, utc_s: float, start: FloatArray, sigma_rad: float, rates: FloatArray
    ) -> RegisteredAngles | RegistrationFault:
        grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        picture = np.asarray(grey, dtype=np.float64)
        seen = find_stars(picture, most=_MOST_IN_OPERATION) if self._bounded else find_stars(picture)
        if len(seen) < _LEAST_STARS:
            return RegistrationFault.NO_STARS
        matched = self._expected(seen, start, _SEARCH_SIGMAS * sigma_rad, utc_s)
        if matched is None and not self._bounded:
            matched = self._solved(seen, utc_s)
        found = None if matched is None else self._fit(matched, start, rates)
        if found is None:
            return RegistrationFault.OTHER_STARS
        away = max(abs(found.pan_rad - start[0]), abs(found.tilt_rad - start[1]))
        if away > _SEARCH_SIGMAS * float(np.hypot(sigma_rad, found.sigma_rad)):
            return RegistrationFault.TOO_FAR
        # those of the fit are the stamp's if the rates are right
        pan, tilt = (np.array([found.pan_rad, found.tilt_rad]) + found.delay_s * rates).tolist()
        return replace(found, pan_rad=pan, tilt_rad=tilt)

    def _expected(self, seen: StarImages, angles: FloatArray, reach_rad: float, utc_s: float) -> _Matched | None:
        """Return the stars that share a shift from where angles expect them; None where chance does as well."""
        stars, towards, expected = self._in_view(angles, reach_rad, utc_s)
        if len(stars) < _LEAST_STARS:
            return None
        focal = float(self._station.lens.focal_px.max())
        shift = _common_shift(seen.pixel_px, expected, focal * reach_rad + _NEAR_PX)
        image, star = match_stars(seen, stars, expected + shift, _SHIFT_PX)
        w, h = self._station.lens.image_size_px
        by_chance = len(seen) * len(stars) * np.pi * _SHIFT_PX**2 / (w * h)
        tried = max(1.0, ((focal * reach_rad + _NEAR_PX) / _SHIFT_PX) ** 2)
        # the best of many shifts has more than one of them
        if len(image) < max(_LEAST_STARS, _CHANCE_FACTOR * by_chance + np.log10(tried)):
            return None
        return self._matched(seen, image, towards[star])

    def _in_view(
        self, angles: FloatArray, reach_rad: float, utc_s: float
    ) -> tuple[CatalogueStars, FloatArray, FloatArray]:
        """Return the stars in view at angles: of the catalogue, their directions (n, 3) and pixels (n, 2)."""
        pan, tilt = angles.tolist()
        lens = self._station.lens
        axis = self._sky.icrs_from_runway(utc_s) @ self._station.geometry().camera_pose(pan, tilt).runway_from_camera
        corner = np.arctan(np.linalg.norm(0.5 * np.array(lens.image_size_px) / lens.focal_px))
        # aberration and refraction move what is expected by less than 1°
        near = self._solver.near(axis[:, 2], float(corner) + reach_rad + np.radians(1.0))
        towards = self._sky.stars(near.ra_rad, near.dec_rad, utc_s)
        pixel, inside = expected_pixels(self._station, (pan, tilt), towards)
        rows = np.flatnonzero(inside)
        return near.of(rows), towards[rows], pixel[rows]

    def _solved(self, seen: StarImages, utc_s: float) -> _Matched | None:
        solved = self._solver.solve(seen)
        if isinstance(solved, str):
            return None
        towards = self._sky.stars(solved.stars.ra_rad, solved.stars.dec_rad, utc_s)
        return self._matched(seen, solved.image, towards)

    def _matched(self, seen: StarImages, image: IntArray, towards: FloatArray) -> _Matched:
        pixel, height = seen.pixel_px[image], self._station.lens.image_size_px[1]
        return _Matched(
            pixel_px=pixel,
            sigma_px=np.hypot(seen.sigma_px[image], _MODEL_SIGMA_PX),
            towards=towards,
            delay_s=row_delay_s(pixel[:, 1], height, self._station.readout_s),
        )

    def _fit(self, stars: _Matched, start: FloatArray, rates: FloatArray) -> RegisteredAngles | None:
        """Return pan and tilt by Gauss-Newton with outliers left out; None where most stars do not fit."""
        angles, used = start.copy(), np.ones(len(stars.pixel_px), dtype=np.bool_)
        weight = np.repeat(1.0 / stars.sigma_px, 2)
        columns, misfit, scale = np.zeros((0, 2)), np.zeros(0), 1.0
        rows = np.repeat(used, 2)
        for _ in range(_ROUNDS):
            off, by_angles = self._linear(stars, angles, rates)
            rows = np.repeat(used, 2)
            columns = (by_angles * weight[:, None])[rows]
            change = np.linalg.lstsq(columns, (off * weight)[rows], rcond=None)[0]
            angles = angles + change
            off = self._linear(stars, angles, rates)[0].reshape(-1, 2)
            misfit = np.linalg.norm(off, axis=1) / stars.sigma_px
            # far from the solution all are far off
            scale = max(1.0, float(np.median(misfit)) / 1.18)
            used = misfit < _OUTLIER_SIGMAS * scale
            if int(used.sum()) < _LEAST_STARS:
                return None
            if float(np.abs(change).max()) < 1e-8:
                break
        if float(used.mean()) < _LEAST_INLIERS or scale > _OUTLIER_SIGMAS:
            return None
        normal = columns.T @ columns
        factor = max(1.0, float(np.mean(misfit[used] ** 2)) / 2.0)
        own = float(np.sqrt(np.diag(np.linalg.inv(normal)).max() * factor))
        least = _LEAST_SIGMA_PX / float(self._station.lens.focal_px.min())
        # by how much the angles move with the rates, as of the panorama's
        late = columns * np.repeat(stars.delay_s, 2)[rows, None]
        delay_s = 0.5 * float(np.trace(np.linalg.solve(normal, columns.T @ late)))
        return RegisteredAngles(
            pan_rad=float(angles[0]),
            tilt_rad=float(angles[1]),
            sigma_rad=float(np.hypot(own, least)),
            delay_s=delay_s,
        )

    def _linear(self, stars: _Matched, angles: FloatArray, rates: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return how far stars (2 n,) are from where angles have them, px, and that by the angles, (2 n, 2)."""

        def at(pan: float, tilt: float) -> FloatArray:
            own = np.array([pan, tilt]) + np.outer(stars.delay_s, rates)
            return expected_pixels(self._station, own, stars.towards)[0].ravel()

        pan, tilt = angles.tolist()
        here = at(pan, tilt)
        by = [at(pan + _STEP_RAD, tilt) - here, at(pan, tilt + _STEP_RAD) - here]
        return stars.pixel_px.ravel() - here, np.column_stack(by) / _STEP_RAD


def _common_shift(seen_px: FloatArray, expected_px: FloatArray, reach_px: float) -> FloatArray:
    """Return the shift (2,) within a reach that brings most expected pixels to seen ones; zero where none does."""
    apart = (seen_px[:, None, :] - expected_px[None, :, :]).reshape(-1, 2)
    apart = apart[np.linalg.norm(apart, axis=1) <= reach_px]
    if not len(apart):
        return np.zeros(2)
    neighbours = KDTree(apart).query_ball_point(apart, _SHIFT_PX)
    best = max(neighbours, key=len)
    return np.asarray(np.median(apart[best], axis=0))


def star_angles(session: Session, zero_utc_s: float) -> Mapping[str, StarAngles]:
    """Return what takes angles of all turning stations of a session from the stars, as of a replay's request.

    Raises `InputError` for a session that does not say where it is and for a moment of which no places are known, and
    `MissingExtraError` without the extra `stars`.
    """
    _require_places(zero_utc_s, "--stars")
    if session.origin is None:
        wanted = "a table [origin]: where the runway frame lies on Earth"
        raise InputError(f"{session.name}: session.toml", got="no [origin]", wanted=wanted)
    return _angles_over(session.rig, session.origin, session.air, zero_utc_s, in_operation=False)


def star_angles_in_operation(rig: Rig, origin: GeoOrigin, air: SiteAir, zero_utc_s: float) -> Mapping[str, StarAngles]:
    """Return what takes angles of all turning stations of a station in operation, within bounded time.

    Raises `MissingExtraError` without the extra `stars`, and `InputError` for a lens of which there are no patterns and
    a clock that is decades off.
    """
    _require_places(zero_utc_s, "this machine's clock")
    return _angles_over(rig, origin, air, zero_utc_s, in_operation=True)


def _require_places(utc_s: float, where: str) -> None:
    """Raise `InputError` for a moment of which no places are known."""
    if not FIRST_UTC_S < utc_s < LAST_UTC_S:
        # whole years
        first, last = (
            datetime.fromtimestamp(FIRST_UTC_S, UTC).year + 1,
            datetime.fromtimestamp(LAST_UTC_S, UTC).year - 1,
        )
        got, wanted = "a moment of which no places of stars are known", f"one from {first} to {last}"
        raise InputError(where, got=got, wanted=wanted)


def _angles_over(
    rig: Rig, origin: GeoOrigin, air: SiteAir, zero_utc_s: float, *, in_operation: bool
) -> Mapping[str, StarAngles]:
    sky = SkyOverSite(
        ObservingSite(
            lat_deg=origin.lat_deg,
            lon_deg=origin.lon_deg,
            height_m=origin.height_m,
            y_axis_azimuth_deg=origin.y_axis_azimuth_deg,
            pressure_hpa=air.pressure_hpa,
            air_c=air.air_c,
        )
    )
    year = decimal_year([zero_utc_s])
    turning = [station for station in rig.stations if not station.fixed]
    if not in_operation:
        return {s.name: StarAngles(s, sky, StarSolver(s.lens, year), zero_utc_s) for s in turning}
    # patterns are not used in operation: those of one lens do for all, and the narrowest has the faintest stars
    lenses = sorted((station.lens for station in turning), key=lambda lens: -float(lens.focal_px[0]))
    solvers = [StarSolver(lens, year) for lens in lenses[:1]]
    return {s.name: StarAngles(s, sky, solver, zero_utc_s, in_operation=True) for s in turning for solver in solvers}


def _rehearsed_picture(size_px: tuple[int, int]) -> ImageArray:
    """Return a dark picture with as many dots as are looked at in operation."""
    w, h = size_px
    random = np.random.default_rng(0)
    dots, places = np.zeros((h, w)), random.uniform(0.05, 0.95, (_MOST_IN_OPERATION, 2)) * np.array([w, h])
    for u, v in places.astype(np.int64).tolist():
        dots[v, u] = 1000.0
    picture = random.normal(20.0, 2.0, (h, w)) + cv2.GaussianBlur(dots, (0, 0), 1.2)
    return np.asarray(np.clip(picture, 0, 255), dtype=np.uint8)
