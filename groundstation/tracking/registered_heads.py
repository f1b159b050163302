"""Head angles of frames by panoramas: where a frame fits, its own pan and tilt; where not, the encoder's, and why."""

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace

from groundstation.detection.panorama import GroundPanorama, HeadRegistration, RegisteredAngles
from groundstation.errors import RigError
from groundstation.messages import Frame, PtuSample
from groundstation.picture import as_picture
from groundstation.rig.rig import Rig
from groundstation.tracking.synchronise import InterpolatedAngles, ReadyFrame

NOT_RECORDED = "only parts of the picture"


class RegisteredHeads:
    """Registers the frames of stations that have a panorama; counts which were, and why others were not.

    Raises `RigError` for a panorama of a station that the rig has not, or that does not turn.
    """

    def __init__(self, rig: Rig, panoramas: Mapping[str, GroundPanorama]) -> None:
        for name in panoramas:
            if name not in rig.names or rig[name].fixed:
                turning = ", ".join(s.name for s in rig.stations if not s.fixed)
                raise RigError("panorama", got=f"one of station {name}", wanted=f"some of {turning}, which turn")
        self._heads = {name: HeadRegistration(rig[name], panorama) for name, panorama in panoramas.items()}
        self._sigma_rad = {name: rig[name].angle_sigma_rad for name in panoramas}
        self._registered: Counter[str] = Counter()
        self._failed: dict[str, Counter[str]] = {name: Counter() for name in panoramas}

    def improve(self, ready: ReadyFrame, fuse: Callable[[PtuSample], None]) -> ReadyFrame:
        """Return a frame with the angles of its picture, which are fused as a reading of its instant; or as it is."""
        record, angles = ready.record, ready.angles
        head = self._heads.get(record.station)
        if head is None or not isinstance(record, Frame) or not isinstance(angles, InterpolatedAngles):
            return ready
        picture = as_picture(record.image)
        if not picture.has_all:
            self._failed[record.station][NOT_RECORDED] += 1
            return ready
        encoder = self._sigma_rad[record.station]
        found = head.register(picture.whole(), angles.pan_rad, angles.tilt_rad, encoder)
        if not isinstance(found, RegisteredAngles):
            self._failed[record.station][found.value] += 1
            return ready
        self._registered[record.station] += 1
        fuse(
            PtuSample(
                t_s=record.t_s,
                station=record.station,
                pan_rad=found.pan_rad,
                tilt_rad=found.tilt_rad,
                sigma_rad=found.sigma_rad,
            )
        )
        share = (found.sigma_rad / encoder) ** 2 if encoder > 0.0 else angles.variance_share
        own = InterpolatedAngles(pan_rad=found.pan_rad, tilt_rad=found.tilt_rad, variance_share=share)
        return replace(ready, angles=own)

    def notes(self) -> list[str]:
        """Return a line for each station: how many frames have the picture's angles, and why others have not."""
        lines = []
        for name, failed in self._failed.items():
            total = self._registered[name] + sum(failed.values())
            why = "".join(f"; {count} the encoder's: {reason}" for reason, count in sorted(failed.items()))
            lines.append(f"head angles of {name} from the picture in {self._registered[name]} of {total} frames{why}")
        return lines
