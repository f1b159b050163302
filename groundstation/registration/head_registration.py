"""Head angles from the picture: a frame registered to a panorama of the ground around, made by the same head.

The panorama has the grey of each direction of the base frame. A frame's textured pixels are laid on it at the angles
that the encoders give, and pan and tilt are moved until they fit: Gauss-Newton on grey levels, with brightness and
contrast of the frame free and large differences (the aircraft, birds, what was moved) of little weight. Where the
picture shows too little ground, or does not fit, it says so.

Behind a rolling shutter each row is exposed at its own time, and a head that turns has other angles then. The rows are
laid where a rate puts them, and what comes out are the angles of the instant at which the rows that were used were
exposed, weighed as the fit weighs them: the ground is in the lower rows, which is not the middle of the picture, whose
time the stamp is. Where the same rows tell pan and tilt, those angles do not depend on the rate, to the first order of
its error. Where others tell either, horizontal borders near the horizon and poles below it, they do by half of the time
between these rows: 0.002° for an error of 1 °/s and 20 ms of readout.
"""

from dataclasses import dataclass, replace
from enum import Enum

import cv2
import numpy as np

from groundstation.arrays import FloatArray, ImageArray, IntArray
from groundstation.registration.panorama import GroundPanorama, PictureRays, halved_grey
from groundstation.rig.rig import Station

_MOST_PIXELS, _LEAST_PIXELS = 3000, 200
_TEXTURE = 4.0
_ROUNDS, _CLOSE_PX = 12, 0.01
_ROBUST = 8.0
# of the search where angles are known poorly: step and pixels used
_SEARCH_STEP_PX, _SEARCH_PIXELS, _SEARCH_CLIP = 3, 500, 25.0
_SEARCH_SIGMAS = 4.0
_NEAR_PX = 3.0
# a match: of the pixels that are within three robust scales, and the correlation with the panorama
_LEAST_INLIERS, _LEAST_CORRELATION = 0.6, 0.8
# rates of pan and tilt, rad/s, of a head that stands
STANDING = (0.0, 0.0)
# neighbouring pixels' misfits are not independent, and a panorama is not exact
_CORRELATED, _LEAST_SIGMA_PX = 3.0, 0.05


class RegistrationFault(Enum):
    """Why a frame's angles are the encoder's."""

    NO_PANORAMA = "no panorama there"
    NO_TEXTURE = "too little ground in view"
    NO_STARS = "too few stars in view"
    NO_MATCH = "the view is not the panorama's"
    OTHER_STARS = "the stars are not those of the time and place"
    DAYLIGHT = "the Sun is up"
    NO_PLACES = "a time of which no places of stars are known"
    TOO_FAR = "farther from the encoder's angles than they may be off"


@dataclass(frozen=True, slots=True, kw_only=True)
class RegisteredAngles:
    """Pan and tilt by a frame's picture, ``delay_s`` after the frame's stamp, and one sigma of each, rad."""

    pan_rad: float
    tilt_rad: float
    sigma_rad: float
    delay_s: float = 0.0


class HeadRegistration:
    """Registers the frames of one station to its panorama."""

    def __init__(self, station: Station, panorama: GroundPanorama) -> None:
        self._rays, self._panorama = PictureRays(station), panorama
        self._grey = np.ascontiguousarray(panorama.grey, dtype=np.float32)
        by_x = cv2.Sobel(self._grey, cv2.CV_32F, 1, 0, ksize=3) / 8.0
        by_y = cv2.Sobel(self._grey, cv2.CV_32F, 0, 1, ksize=3) / 8.0
        # a gradient that reaches beyond what is known is none
        inside = cv2.erode(panorama.known.astype(np.uint8), np.ones((5, 5), np.uint8))
        layers = (self._grey, by_x, by_y, inside)
        self._layers = tuple(np.asarray(one, dtype=np.float32) for one in layers)

    def searches(self, sigma_rad: float) -> bool:
        """Return whether encoders of one sigma leave so much open that a frame has to be searched for."""
        return _SEARCH_SIGMAS * sigma_rad / self._panorama.step_rad > _NEAR_PX

    def register(
        self,
        image: ImageArray,
        pan_rad: float,
        tilt_rad: float,
        sigma_rad: float,
        rates_rad_s: tuple[float, float] = STANDING,
    ) -> RegisteredAngles | RegistrationFault:
        """Return the angles of a frame whose encoders read so, to one sigma; or why the encoders' have to do.

        The encoders' are those of the stamp; ``rates_rad_s`` of pan and tilt of a head that turns.
        """
        return self.register_grey(halved_grey(image), pan_rad, tilt_rad, sigma_rad, rates_rad_s)

    def register_at(
        self,
        image: ImageArray,
        t_s: float,
        pan_rad: float,
        tilt_rad: float,
        sigma_rad: float,
        rates_rad_s: tuple[float, float] = STANDING,
    ) -> RegisteredAngles | RegistrationFault:
        """Return `register` of a frame of any time: the ground stands still."""
        return self.register(image, pan_rad, tilt_rad, sigma_rad, rates_rad_s)

    def register_grey(
        self,
        grey: FloatArray,
        pan_rad: float,
        tilt_rad: float,
        sigma_rad: float,
        rates_rad_s: tuple[float, float] = STANDING,
    ) -> RegisteredAngles | RegistrationFault:
        """Register a frame that is halved already."""
        chosen = self._textured(grey, pan_rad, tilt_rad)
        if isinstance(chosen, RegistrationFault):
            return chosen
        seen = _SeenPixels(
            rays=self._rays.rays[chosen],
            level=grey.ravel()[chosen].astype(np.float64),
            delay_s=self._rays.delay_s[chosen],
            turned_rad=self._rays.turned(rates_rad_s, chosen),
        )
        reach_px = _SEARCH_SIGMAS * sigma_rad / self._panorama.step_rad
        pan, tilt = pan_rad, tilt_rad
        if reach_px > _NEAR_PX:
            pan, tilt = self._searched(seen, pan, tilt, reach_px)
        found = self._refined(seen, pan, tilt)
        if isinstance(found, RegisteredAngles):
            away = max(abs(found.pan_rad - pan_rad), abs(found.tilt_rad - tilt_rad))
            if away > _SEARCH_SIGMAS * float(np.hypot(sigma_rad, found.sigma_rad)) + self._panorama.step_rad:
                return RegistrationFault.TOO_FAR
            pan_rate, tilt_rate = rates_rad_s
            # those of the fit are the stamp's if the rates are right
            pan, tilt = found.pan_rad + found.delay_s * pan_rate, found.tilt_rad + found.delay_s * tilt_rate
            return replace(found, pan_rad=pan, tilt_rad=tilt)
        return found

    def _places(
        self, rows: FloatArray, pan_rad: float, tilt_rad: float, turned_rad: FloatArray | None = None
    ) -> FloatArray:
        """Return the panorama's pixels (n, 2) of head directions (n, 3)."""
        p = self._panorama
        towards = self._rays.directions(rows, pan_rad, tilt_rad, turned_rad)
        return (np.array([p.left_rad, p.top_rad]) - towards) / p.step_rad

    def _textured(self, grey: FloatArray, pan_rad: float, tilt_rad: float) -> IntArray | RegistrationFault:
        """Return the numbers of textured pixels that lie where the panorama is known, spread over the picture."""
        by_x, by_y = (cv2.Sobel(np.asarray(grey, np.float32), cv2.CV_32F, *o, ksize=3) / 8.0 for o in ((1, 0), (0, 1)))
        steep = np.hypot(by_x, by_y)
        steep[:2], steep[-2:], steep[:, :2], steep[:, -2:] = 0.0, 0.0, 0.0, 0.0
        numbers = np.flatnonzero(steep.ravel() > _TEXTURE)
        if len(numbers) < _LEAST_PIXELS:
            return RegistrationFault.NO_TEXTURE
        numbers = numbers[:: max(1, len(numbers) // (3 * _MOST_PIXELS))]
        inside = self._sampled(self._places(self._rays.rays[numbers], pan_rad, tilt_rad))[3] > 0.999
        if not inside.any():
            return RegistrationFault.NO_PANORAMA
        numbers = numbers[inside]
        if len(numbers) < _LEAST_PIXELS:
            return RegistrationFault.NO_TEXTURE
        return np.asarray(numbers[:: max(1, len(numbers) // _MOST_PIXELS)])

    def _sampled(self, places: FloatArray) -> list[FloatArray]:
        """Return grey, its two gradients, and how much is known (n,) at pixels (n, 2) of the panorama."""
        u, v = (np.asarray(places[:, k], dtype=np.float32).reshape(1, -1) for k in (0, 1))
        seen = (cv2.remap(np.asarray(one), u, v, cv2.INTER_LINEAR, borderValue=0.0) for one in self._layers)
        return [np.asarray(one, dtype=np.float64).ravel() for one in seen]

    def _searched(self, seen: "_SeenPixels", pan: float, tilt: float, reach_px: float) -> tuple[float, float]:
        """Return the angles on a raster at which the frame fits the panorama best."""
        every = max(1, len(seen.rays) // _SEARCH_PIXELS)
        rows, level = seen.rays[::every], seen.level[::every]
        places = self._places(rows, pan, tilt, None if seen.turned_rad is None else seen.turned_rad[::every])
        steps = _SEARCH_STEP_PX * np.arange(-int(reach_px / _SEARCH_STEP_PX) - 1, int(reach_px / _SEARCH_STEP_PX) + 2)
        best, shift = np.inf, (0.0, 0.0)
        for down in steps.tolist():
            for across in steps.tolist():
                value, _, _, known = self._sampled(places + np.array([across, down]))
                inside = known > 0.999
                if int(inside.sum()) < 0.5 * len(rows):
                    continue
                off = value[inside] - level[inside]
                misfit = float(np.minimum(np.abs(off - np.median(off)), _SEARCH_CLIP).mean())
                if misfit < best:
                    best, shift = misfit, (across, down)
        # to the right is a smaller azimuth; in the middle of the picture a height is a tilt
        return pan - shift[0] * self._panorama.step_rad, tilt - shift[1] * self._panorama.step_rad

    def _refined(self, seen: "_SeenPixels", pan: float, tilt: float) -> RegisteredAngles | RegistrationFault:
        """Return the angles by robust Gauss-Newton, pan and tilt with the frame's brightness and contrast."""
        step, epsilon = self._panorama.step_rad, 1e-4
        rows, level, turned = seen.rays, seen.level, seen.turned_rad
        normal, scale, inliers, correlation, delay_s = np.eye(4), 1.0, 0.0, 0.0, 0.0
        for _ in range(_ROUNDS):
            places = self._places(rows, pan, tilt, turned)
            value, by_x, by_y, known = self._sampled(places)
            inside = known > 0.999
            if int(inside.sum()) < _LEAST_PIXELS:
                return RegistrationFault.NO_TEXTURE
            turned_there = None if turned is None else turned[inside]
            by_tilt = (self._places(rows[inside], pan, tilt + epsilon, turned_there) - places[inside]) / epsilon * step
            gx, gy = by_x[inside], by_y[inside]
            # by a pixel's angle of pan and of tilt: azimuth rises with pan, so that the column falls
            columns = np.column_stack(
                [-gx, gx * by_tilt[:, 0] + gy * by_tilt[:, 1], value[inside], np.ones(int(inside.sum()))]
            )
            contrast, offset = _robust_line(value[inside], level[inside])
            off = level[inside] - (contrast * value[inside] + offset)
            scale = max(1.4826 * float(np.median(np.abs(off))), 1.0)
            columns[:, :2] *= contrast
            weight = 1.0 / (1.0 + (off / max(_ROBUST, 2.0 * scale)) ** 2)
            normal = columns.T @ (weight[:, None] * columns)
            change = np.linalg.lstsq(normal, columns.T @ (weight * off), rcond=None)[0]
            moved = change[:2] * min(1.0, 2.0 / max(float(np.hypot(*change[:2])), 1e-9))
            pan, tilt = pan + float(moved[0]) * step, tilt + float(moved[1]) * step
            fits = np.abs(off) < 3.0 * max(_ROBUST, scale)
            inliers = float(fits.mean())
            correlation = float(np.corrcoef(value[inside][fits], level[inside][fits])[0, 1])
            if float(np.hypot(*moved)) < _CLOSE_PX:
                delay_s = _exposed_s(columns, weight, seen.delay_s[inside])
                break
        else:
            return RegistrationFault.NO_MATCH
        if inliers < _LEAST_INLIERS or correlation < _LEAST_CORRELATION:
            return RegistrationFault.NO_MATCH
        covariance = np.linalg.pinv(normal)[:2, :2] * scale**2 * _CORRELATED**2
        sigma_px = float(np.sqrt(max(np.linalg.eigvalsh(covariance)[1], 0.0)))
        if sigma_px > 1.0:
            return RegistrationFault.NO_TEXTURE
        own = float(np.hypot(sigma_px, _LEAST_SIGMA_PX)) * step
        sigma = float(np.hypot(own, self._panorama.sigma_rad))
        return RegisteredAngles(pan_rad=pan, tilt_rad=tilt, sigma_rad=sigma, delay_s=delay_s)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _SeenPixels:
    """The n pixels that are registered: head directions (n, 3), grey levels and delays after the stamp, s, (n,).

    ``turned_rad`` (n, 2) as `PictureRays.turned`.
    """

    rays: FloatArray
    level: FloatArray
    delay_s: FloatArray
    turned_rad: FloatArray | None


def _exposed_s(columns: FloatArray, weight: FloatArray, delay_s: FloatArray) -> float:
    """Return when the angles that a fit finds were exposed, s after the stamp.

    A head that turns faster by ρ puts each pixel where an angle that is greater by its delay times ρ does: the fit's
    angles move by (CᵀWC)⁻¹CᵀW·C·delay·ρ, with C = ``columns`` (n, 4), of which the first two are of the angles, and W =
    ``weight`` (n,). That is the delay of the angles, of pan and tilt nearly the same one; the rest is second order.
    """
    if not delay_s.any():
        return 0.0
    normal = columns.T @ (weight[:, None] * columns)
    moved = np.linalg.lstsq(normal, columns.T @ (weight[:, None] * columns[:, :2] * delay_s[:, None]), rcond=None)[0]
    return 0.5 * float(moved[0, 0] + moved[1, 1])


def _robust_line(value: FloatArray, level: FloatArray) -> tuple[float, float]:
    """Return contrast and offset of grey levels (n,) over others, with little weight of what is far off."""
    weight = np.ones(len(value))
    contrast, offset = 1.0, 0.0
    for _ in range(3):
        mean = np.average(np.column_stack([value, level]), axis=0, weights=weight)
        off = value - mean[0]
        contrast = float(weight @ (off * (level - mean[1])) / max(float(weight @ off**2), 1e-9))
        contrast = float(np.clip(contrast, 0.5, 2.0))
        offset = float(mean[1] - contrast * mean[0])
        weight = 1.0 / (1.0 + ((level - contrast * value - offset) / _ROBUST) ** 2)
    return contrast, offset
