"""What both ways of recording sightings do at a landmark: turn to it, show it, take pictures, save its rows."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.landmarks.mark_pictures import MarkPictures
from calibration.landmarks.mark_registration import (
    MarkReference,
    NoRegisteredMark,
    RegisteredMark,
    register_mark,
    row_sigmas,
)
from calibration.landmarks.sighting_table import SightingTable
from calibration.sightings import Landmark, LandmarkSighting
from groundstation.arrays import FloatArray, ImageArray
from groundstation.errors import GroundstationError, InputError
from groundstation.geometry.aim import aim_at
from groundstation.live.sighting_station import SightingStation
from ptu_drivers.monitor import format_moved

# what scatters by more than so many of the sigmas of head, registration and picked pixel is no stop
_MOST_SCATTER = 3.0
# fewer pictures do not tell a scatter
_LEAST_PICTURES = 4
# a direction is aimed at as a point so far away
_FAR_M = 1e6


@dataclass(frozen=True, slots=True, kw_only=True)
class StopSettings:
    """How a stop is recorded: so many pictures, readings for each, and one sigma of a pixel picked by hand, px."""

    pictures: int
    readings: int
    picked_sigma_px: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExpectedAngles:
    """Where a landmark is expected: readings (2,) of pan and tilt, rad, and from what they are known."""

    angles_rad: FloatArray
    source: str


class SightingRecorder:
    """Records the sightings of one station.

    Parameters
    ----------
    tell : called with each line for the user.
    """

    def __init__(
        self,
        station: SightingStation,
        landmarks: Mapping[str, Landmark],
        table: SightingTable,
        pictures: MarkPictures,
        settings: StopSettings,
        tell: Callable[[str], None],
    ) -> None:
        self.station, self.landmarks, self.table = station, landmarks, table
        self._pictures, self._settings, self._tell = pictures, settings, tell
        self._looked: tuple[str, ImageArray] | None = None
        self.stops = 0
        """Stops saved since the start."""

    def rows_of(self, landmark: str) -> int:
        """Return the rows that the table has of a landmark from this station."""
        return self.table.rows_of(self.station.name, landmark)

    def knows(self, landmark: str) -> bool:
        """Return whether there is a picture to register a landmark's mark with."""
        return self._pictures.reference(landmark) is not None

    def expected(self, landmark: str) -> ExpectedAngles | None:
        """Return where a landmark is expected: where it was seen before, or by a calibrated rig; None if unknown."""
        seen = self.table.angles_of(self.station.name, landmark)
        if seen is not None:
            return ExpectedAngles(angles_rad=seen, source="as it was seen before")
        return self._by_rig(landmark)

    def _by_rig(self, landmark: str) -> ExpectedAngles | None:
        station, mark = self.station.calibrated, self.landmarks[landmark]
        if not {"position", "orientation"} <= set(station.known) or mark.place is None:
            return None
        place = mark.place if mark.kind == "point" else station.ptu_position_m + _FAR_M * mark.place
        aim = aim_at(station.geometry(), place)
        if aim is None:
            return None
        readings = station.ptu_axes.readings(aim.pan_rad, aim.tilt_rad, 0.0, 0.0)
        return ExpectedAngles(angles_rad=np.array(readings), source="by the rig")

    def turn_to(self, pan_rad: float, tilt_rad: float) -> None:
        """Turn the head, and tell what came of it."""
        self._looked = None
        for moved in self.station.turn_to(pan_rad, tilt_rad):
            self._tell(format_moved(moved))

    def look(self, landmark: str, centre_px: FloatArray | None = None) -> None:
        """Write a picture of now, and a part of it enlarged: about a pixel (2,), else the known mark or the centre."""
        taken = next(self.station.pictures(1, 1))
        self._looked = (landmark, taken.image)
        found = None
        if centre_px is None and (reference := self._pictures.reference(landmark)) is not None:
            found = register_mark(reference, taken.image)
        if centre_px is None:
            h, w = taken.image.shape[:2]
            centre_px = np.array([w / 2, h / 2])
            if found is not None and not isinstance(found, NoRegisteredMark):
                centre_px = found.pixel_px
                u, v = centre_px
                self._tell(f"by its earlier picture the mark is at {u:.2f} {v:.2f} px: `same` records it there")
        for path in self._pictures.show(landmark, taken.image, centre_px):
            self._tell(f"wrote {path}")

    def record_picked(self, landmark: str, pixel_px: FloatArray) -> None:
        """Record a stop by the mark's pixel (2,) in the picture looked at last, otherwise in one of now."""
        looked, self._looked = self._looked, None
        seen = None if looked is None or looked[0] != landmark else looked[1]
        image = next(self.station.pictures(1, 1)).image if seen is None else seen
        h, w = image.shape[:2]
        if not (0.0 <= pixel_px[0] <= w - 1 and 0.0 <= pixel_px[1] <= h - 1):
            got = f"pixel {pixel_px[0]:g} {pixel_px[1]:g}"
            raise InputError(landmark, got=got, wanted=f"one in the picture of {w} × {h} px")
        reference = MarkReference(image=image, pixel_px=pixel_px)
        self._record(landmark, reference, picked=True)
        self._tell(f"wrote {self._pictures.keep(landmark, reference)}")

    def record_same(self, landmark: str) -> None:
        """Record a stop by registration with the picture in which the landmark's pixel is known."""
        reference = self._pictures.reference(landmark)
        if reference is None:
            raise InputError(landmark, got="no earlier picture of it", wanted="its pixel: `look`, then `at U V`")
        self._record(landmark, reference, picked=False)

    def _record(self, landmark: str, reference: MarkReference, *, picked: bool) -> None:
        count = self._settings.pictures
        self._tell(f"{landmark}: taking {count} pictures")
        stop: list[_StopRow] = []
        reason = ""
        for picture in self.station.pictures(count, self._settings.readings):
            found = register_mark(reference, picture.image)
            mark = None if isinstance(found, NoRegisteredMark) else found
            reason = found.reason if isinstance(found, NoRegisteredMark) else reason
            stop.append(_StopRow(t_s=picture.t_s, angles_rad=picture.angles_rad, mark=mark))
        if not any(seen.mark for seen in stop):
            if not picked:
                raise GroundstationError(f"{landmark}: not found in {count} pictures: {reason}")
            self._tell(f"{landmark}: the picked pixel holds for all of its pictures: {reason}")
            sigma = self._settings.picked_sigma_px
            # of equal pixels in a stop the survey counts one
            same = RegisteredMark(pixel_px=reference.pixel_px, sigma_px=sigma)
            self._save(landmark, [replace(seen, mark=same) for seen in stop], [sigma] * count)
            return
        found_ones = [seen for seen in stop if seen.mark is not None]
        if len(found_ones) < count:
            self._tell(f"{landmark}: left out {count - len(found_ones)} of {count} pictures: {reason}")
        own = [seen.mark.sigma_px for seen in found_ones if seen.mark is not None]
        self._save(landmark, found_ones, row_sigmas(own, self._settings.picked_sigma_px))

    def _save(self, landmark: str, stop: Sequence["_StopRow"], sigmas_px: Sequence[float]) -> None:
        """Append a stop's rows, and tell what they say; raises `GroundstationError` for one that scatters."""
        self._require_still(landmark, stop)
        self._warn_of_direction(landmark, stop[0].angles_rad)
        pan_from, tilt_from = self.station.senses
        rows = [
            LandmarkSighting(
                station=self.station.name,
                landmark=landmark,
                pan_rad=float(seen.angles_rad[0]),
                tilt_rad=float(seen.angles_rad[1]),
                pixel_px=seen.mark.pixel_px,
                sigma_px=sigma,
                t_s=seen.t_s,
                pan_from=pan_from,
                tilt_from=tilt_from,
                line=0,
            )
            for seen, sigma in zip(stop, sigmas_px, strict=True)
            if seen.mark is not None
        ]
        self.table.append(rows)
        self.stops += 1
        pan, tilt = np.degrees(np.median([(r.pan_rad, r.tilt_rad) for r in rows], axis=0))
        pixels = [r.pixel_px for r in rows]
        u, v = np.median(pixels, axis=0)
        self._tell(
            f"{landmark}: saved {len(rows)} rows: pan {pan:+.4f}, tilt {tilt:+.4f} deg, pixel {u:.2f} {v:.2f}, "
            f"scattered by {float(np.std(pixels, axis=0).max()):.3f} px"
        )

    def _require_still(self, landmark: str, stop: Sequence["_StopRow"]) -> None:
        """Raise `GroundstationError` where angles or pixels scatter by more than the head's noise explains."""
        if len(stop) < _LEAST_PICTURES:
            return
        station = self.station.calibrated
        # a fixed station has no head that moves
        angle_rad = station.angle_sigma_rad if self.station.turns else 0.0
        marks = [seen.mark for seen in stop if seen.mark is not None]
        own_px = float(np.sqrt(np.mean([mark.sigma_px**2 for mark in marks]) + self._settings.picked_sigma_px**2))
        found = (
            (
                "pixels",
                "px",
                np.std([mark.pixel_px for mark in marks], axis=0).max(),
                float(np.hypot(own_px, angle_rad * float(station.lens.focal_px.max()))),
            ),
            (
                "angles",
                "deg",
                np.degrees(np.std([seen.angles_rad for seen in stop], axis=0).max()),
                float(np.degrees(angle_rad)),
            ),
        )
        for what, unit, scatter, sigma in found:
            if scatter > _MOST_SCATTER * sigma and (what == "pixels" or self.station.turns):
                got = f"{what} scattered by {scatter:.3g} {unit} over {len(stop)} pictures"
                wanted = f"at most {_MOST_SCATTER * sigma:.2g} {unit}, as the head's noise explains"
                where = f"{landmark}: left out, repeat it once head and mast are still"
                raise InputError(where, got=got, wanted=wanted)

    def _warn_of_direction(self, landmark: str, angles_rad: FloatArray) -> None:
        """Tell where a landmark cannot be in the picture by a calibrated rig: probably it is another one."""
        expected = self._by_rig(landmark)
        if expected is None or not self.station.turns:
            return
        lens = self.station.calibrated.lens
        diagonal_rad = float(np.hypot(*(np.array(lens.image_size_px) / lens.focal_px)))
        apart_rad = float(np.abs(expected.angles_rad - angles_rad).max())
        if apart_rad > diagonal_rad:
            degrees = np.degrees(apart_rad)
            self._tell(f"{landmark}: is it this one? By the rig it is {degrees:.1f} deg from where the head points")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _StopRow:
    """One picture of a stop: time, angles (2,) rad, and the mark; None where it was not found."""

    t_s: float
    angles_rad: FloatArray
    mark: RegisteredMark | None
