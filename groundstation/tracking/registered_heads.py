"""Head angles of frames by panoramas: where a frame fits, its own pan and tilt; where not, the encoder's, and why."""

import math
from collections import Counter, deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Protocol

import cv2

from groundstation.arrays import ImageArray
from groundstation.errors import RigError
from groundstation.estimation.encoder_offset import OffsetEstimator
from groundstation.geometry.head_rates import HeadRates
from groundstation.messages import Frame, FrameAngles, PtuSample
from groundstation.picture import as_picture
from groundstation.registration.head_registration import STANDING, HeadRegistration, RegisteredAngles, RegistrationFault
from groundstation.registration.panorama import GroundPanorama
from groundstation.rig.rig import Rig
from groundstation.tracking.synchronise import InterpolatedAngles, ReadyFrame

NOT_RECORDED = "only parts of the picture"
OTHER_SIZE = "a picture of another size than in the rig"
OPENCV_FAILED = "OpenCV fails in the picture"
BETWEEN_SEARCHES = "so poor an encoder wants a search, which is not done for each frame"
BETWEEN_STARS = "stars are not looked for in each frame"
_MOST_RECALLED = 1000


class AnglesFromPicture(Protocol):
    """What tells a head's angles from a frame: the ground, the stars."""

    def searches(self, sigma_rad: float) -> bool:
        """Return whether encoders of one sigma make a frame take too long for operation."""
        ...

    def register_at(
        self,
        image: ImageArray,
        t_s: float,
        pan_rad: float,
        tilt_rad: float,
        sigma_rad: float,
        rates_rad_s: tuple[float, float] = STANDING,
    ) -> RegisteredAngles | RegistrationFault:
        """Return the angles of a frame (h, w, 3) of session time ``t_s`` whose encoders read so; or why not.

        ``rates_rad_s`` are about those of pan and tilt, for the rows of a rolling shutter.
        """
        ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Way:
    """One way to a head's angles, and in which frames it is tried: every so many, beginning with the ``first``."""

    angles: AnglesFromPicture
    every: int
    between: str
    first: int = 0

    def skips(self, frame: int) -> bool:
        """Return whether it is not tried in a frame, counted from 0."""
        return (frame - self.first) % self.every != 0


# the rates of a station's head
RatesOf = Callable[[str], HeadRates]


def _at_stamp(found: FrameAngles, rates: HeadRates) -> FrameAngles:
    """Return the angles of a picture at its stamp, by the head's rates and their sigma."""
    if found.delay_s == 0.0:
        return found
    return replace(
        found,
        pan_rad=found.pan_rad - found.delay_s * rates.pan_rad_s,
        tilt_rad=found.tilt_rad - found.delay_s * rates.tilt_rad_s,
        sigma_rad=math.hypot(found.sigma_rad, found.delay_s * rates.sigma_rad_s),
        delay_s=0.0,
    )


class RegisteredHeads:
    """Registers the frames of stations that have a panorama or stars; counts which were, and why others were not.

    Parameters
    ----------
    rig : its stations. panoramas : by station; none where angles come from a recording alone.
    stars : by station, what is tried where the ground does not tell.
    where : what the panoramas came from, for the error.
    search_every : of a head whose encoder is so poor that a frame has to be searched for, every how many frames are
        registered: in operation a search takes too long for each. stars_every : the same of stars, for the heads in
        turn.

    Frames that do not tell have the encoder's angles without the slow part of its error, as those that told have found
    it (`OffsetEstimator`); so have the readings that are fused between them.
    Angles of a recording's `FrameAngles` are taken as they are of stations without a panorama, and of frames of which
    only parts were recorded; where there are stars and no panorama, if the stars do not tell. Raises `RigError` for a
    panorama of a station that the rig has not, or that does not turn.
    """

    def __init__(
        self,
        rig: Rig,
        panoramas: Mapping[str, GroundPanorama],
        search_every: int = 1,
        where: str = "panorama",
        stars: Mapping[str, AnglesFromPicture] | None = None,
        stars_every: int = 1,
    ) -> None:
        for name in panoramas:
            if name not in rig.names or rig[name].fixed:
                turning = ", ".join(s.name for s in rig.stations if not s.fixed)
                wanted = f"some of {turning}, which turn" if turning else "none: no station of the rig turns"
                raise RigError(where, got=f"one of station {name}", wanted=wanted)
        self._sigma_rad = {s.name: s.angle_sigma_rad for s in rig.stations}
        self._sizes_px = {s.name: s.lens.image_size_px for s in rig.stations}
        self._heads: dict[str, tuple[_Way, ...]] = {}
        for name, panorama in panoramas.items():
            ground = HeadRegistration(rig[name], panorama)
            every = search_every if ground.searches(self._sigma_rad[name]) else 1
            self._heads[name] = (_Way(angles=ground, every=every, between=BETWEEN_SEARCHES),)
        for k, (name, by_stars) in enumerate((stars or {}).items()):
            way = _Way(
                angles=by_stars, every=stars_every, between=BETWEEN_STARS, first=k * stars_every // len(stars or {})
            )
            self._heads[name] = (*self._heads.get(name, ()), way)
        self._stars_alone = frozenset(self._heads) - frozenset(panoramas)
        self._offsets = {name: OffsetEstimator(sigma) for name, sigma in self._sigma_rad.items()}
        self._frames: Counter[str] = Counter()
        self._registered: Counter[str] = Counter()
        self._recorded: Counter[str] = Counter()
        self._failed: dict[str, Counter[str]] = {name: Counter() for name in self._heads}
        self._recalled: dict[tuple[str, float], FrameAngles] = {}
        # the oldest are dropped where no recording takes them
        self._found: deque[FrameAngles] = deque(maxlen=_MOST_RECALLED)

    @property
    def names(self) -> tuple[str, ...]:
        """The stations that have a panorama or stars."""
        return tuple(self._heads)

    def recall(self, angles: FrameAngles) -> None:
        """Note the angles of a frame that is not processed yet, from a recording."""
        self._recalled[angles.station, angles.t_s] = angles
        if len(self._recalled) > _MOST_RECALLED:
            # of frames that were lost
            self._recalled.pop(next(iter(self._recalled)))

    def take_found(self) -> list[FrameAngles]:
        """Return the angles that were taken since the last call, for a recording."""
        found = list(self._found)
        self._found.clear()
        return found

    def with_angles(self, ready: ReadyFrame, fuse: Callable[[PtuSample], None], rates: RatesOf) -> ReadyFrame:
        """Return a frame with the angles of its picture as `improve` does; where that does not tell, as `carried`."""
        better = self.improve(ready, fuse, rates)
        return self.carried(ready) if better is ready else better

    def improve(self, ready: ReadyFrame, fuse: Callable[[PtuSample], None], rates: RatesOf) -> ReadyFrame:
        """Return a frame with the angles of its picture at its stamp; or as it is.

        The angles are fused as a reading of the instant at which the rows that told were exposed. ``rates`` returns
        those of a station's head at the stamp, as far as readings until then tell.
        """
        record, angles = ready.record, ready.angles
        if not isinstance(record, Frame) or not isinstance(angles, InterpolatedAngles):
            return ready
        name, encoder = record.station, self._sigma_rad[record.station]
        head = rates(name)
        found = self._angles_of(record, angles, (head.pan_rad_s, head.tilt_rad_s))
        if found is None:
            return ready
        offset = self._offsets[name]
        offset.take(angles.pan_rad, angles.tilt_rad, angles.variance_share, _at_stamp(found, head))
        fuse(
            PtuSample(
                t_s=found.t_s + found.delay_s,
                station=name,
                pan_rad=found.pan_rad,
                tilt_rad=found.tilt_rad,
                sigma_rad=found.sigma_rad,
                encoder_off_rad=offset.offset.off_rad,
            )
        )
        # the reading has told of the rates, too
        stamp = _at_stamp(found, rates(name))
        share = (stamp.sigma_rad / encoder) ** 2 if encoder > 0.0 else angles.variance_share
        own = InterpolatedAngles(pan_rad=stamp.pan_rad, tilt_rad=stamp.tilt_rad, variance_share=share)
        return replace(ready, angles=own)

    def carried(self, ready: ReadyFrame) -> ReadyFrame:
        """Return a frame with the encoder's angles, without what pictures have found the encoder to be off."""
        angles = ready.angles
        if not isinstance(angles, InterpolatedAngles):
            return ready
        pan_off, tilt_off = self._offsets[ready.record.station].offset.near(angles.pan_rad, angles.tilt_rad)
        if pan_off == tilt_off == 0.0:
            return ready
        own = replace(angles, pan_rad=angles.pan_rad - pan_off, tilt_rad=angles.tilt_rad - tilt_off)
        return replace(ready, angles=own)

    def _angles_of(
        self, frame: Frame, angles: InterpolatedAngles, rates_rad_s: tuple[float, float]
    ) -> FrameAngles | None:
        """Return the angles of a frame's picture, its own or those recorded; None where the encoder's have to do."""
        name = frame.station
        recorded = self._recalled.pop((name, frame.t_s), None)
        if recorded is None:
            return self._register(frame, angles, rates_rad_s, spare=False)
        if name in self._heads and as_picture(frame.image).has_all:
            spare = name in self._stars_alone
            own = self._register(frame, angles, rates_rad_s, spare=spare)
            if own is not None or not spare:
                return own
        self._recorded[name] += 1
        if self._heads:
            # those of a recording of this run are what the run used
            self._found.append(recorded)
        return recorded

    def _register(
        self, frame: Frame, angles: InterpolatedAngles, rates_rad_s: tuple[float, float], *, spare: bool
    ) -> FrameAngles | None:
        """Return the angles of a frame's picture; None, counted unless there are spare ones, where it does not tell."""
        name = frame.station
        ways = self._heads.get(name)
        if ways is None:
            return None
        self._frames[name] += 1
        # not counted as read: a recording keeps the parts that the detection reads
        picture = as_picture(frame.image)
        if not picture.has_all or picture.size_px != self._sizes_px[name]:
            self._failed[name][NOT_RECORDED if picture.size_px == self._sizes_px[name] else OTHER_SIZE] += 1
            return None
        found: RegisteredAngles | None = None
        why = []
        for way in ways:
            if way.skips(self._frames[name] - 1):
                why.append(way.between)
                continue
            read = (angles.pan_rad, angles.tilt_rad, self._sigma_rad[name])
            try:
                told = way.angles.register_at(picture.preview(), frame.t_s, *read, rates_rad_s)
            except cv2.error:
                why.append(OPENCV_FAILED)
                continue
            if isinstance(told, RegisteredAngles):
                found = told
                break
            why.append(told.value)
        if found is None:
            if not spare:
                self._failed[name][" and ".join(why)] += 1
            return None
        own = FrameAngles(
            t_s=frame.t_s,
            station=name,
            pan_rad=found.pan_rad,
            tilt_rad=found.tilt_rad,
            sigma_rad=found.sigma_rad,
            delay_s=found.delay_s,
        )
        self._found.append(own)
        self._registered[name] += 1
        return own

    def notes(self) -> list[str]:
        """Return a line for each station: how many frames have the picture's angles, and why others have not."""
        lines = []
        for name, failed in self._failed.items():
            total = self._registered[name] + sum(failed.values())
            why = "".join(f"; {count} the encoder's: {reason}" for reason, count in sorted(failed.items()))
            lines.append(f"head angles of {name} from the picture in {self._registered[name]} of {total} frames{why}")
        for name, count in self._recorded.items():
            lines.append(f"head angles of {name} in {count} frames from the recording")
        return lines
