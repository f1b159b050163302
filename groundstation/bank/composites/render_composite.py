"""A composite's frames with their exact truth; the same specification and clip give the same frames, bit for bit."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.bank.composites.body_layer import BodyLayer, LayerPainter
from groundstation.bank.composites.clip_sets import require_clip_of
from groundstation.bank.composites.composite_light import CompositeLight
from groundstation.bank.composites.composite_spec import RATE_HZ, CompositeSpec
from groundstation.bank.composites.layered_picture import layered
from groundstation.bank.composites.picture_light import is_sky, sky_mask
from groundstation.bank.composites.segment_view import SegmentFootage
from groundstation.bank.session_truth import LEAST_SHARE_SEEN, LEAST_SNR, LEAST_WIDTH_PX
from groundstation.box import Box, box_of_size
from groundstation.errors import ScenarioError
from groundstation.simulation.airframes.build import build_airframe
from groundstation.simulation.attitude import AircraftPose, pose_at
from groundstation.simulation.body_raster import BodyExposure, BodyRaster
from groundstation.simulation.head_motion import HeadMotion
from groundstation.simulation.render_primitives import crop_mask, overlap
from groundstation.simulation.scene_body import AircraftBody, Body
from groundstation.simulation.traffic import TrafficSpec, traffic_bodies
from groundstation.simulation.world.world_sets import set_of
from groundstation.sources.true_silhouettes import TrueSilhouette

_NOISE_STREAM = 461


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CompositeFrame:
    """One picture of a composite, and its truth.

    Attributes
    ----------
    index, t_s : number of the frame in its clip, and its time from the composite's first frame.
    image : (h, w, 3) BGR.
    silhouette : which pixels the drawn aircraft covers by half or more, before any blur; None where none.
    nose_px : (2,) where its nose is, None where it is not in front of the camera.
    width_px : width of the box around the whole aircraft, including its parts outside the picture.
    in_view : share of the whole silhouette that is inside the picture.
    unhidden : share of the silhouette inside the picture that no bird hides.
    snr : matched-filter signal-to-noise ratio of the aircraft's change of the grey level over the clip's noise.
    over_sky : whether the middle of the silhouette is on sky.
    real_aircraft : labelled box of the clip's own aircraft; None where it shows none.
    birds : boxes of the birds, drawn before any blur, in the picture.
    """

    index: int
    t_s: float
    image: ImageArray
    silhouette: TrueSilhouette | None
    nose_px: FloatArray | None
    width_px: float
    in_view: float
    unhidden: float
    snr: float
    over_sky: bool
    real_aircraft: Box[float] | None
    birds: tuple[Box[int], ...]

    @property
    def visible(self) -> bool:
        """Whether it shows the aircraft by the rules of `session_truth`."""
        seen = self.in_view * self.unhidden >= LEAST_SHARE_SEEN and self.silhouette is not None
        return seen and self.width_px >= LEAST_WIDTH_PX and self.snr >= LEAST_SNR


def render_composite(spec: CompositeSpec, clip: SegmentFootage) -> Iterator[CompositeFrame]:
    """Return the frames of a composite, drawn one at a time, over the segment of its clip.

    Raises `ScenarioError` at once where the segment is another's, or of a clip that the seed's set may not use.
    """
    segment = clip.segment
    require_clip_of(set_of(spec.seed), segment.clip)
    if segment.clip != spec.clip or not segment.first <= spec.first <= spec.last <= segment.last:
        got = f"frames {segment.first} to {segment.last} of {segment.clip}"
        wanted = f"frames {spec.first} to {spec.last} of {spec.clip}"
        raise ScenarioError(f"composite {spec.seed}", got=got, wanted=wanted)
    return _CompositeScene(spec, clip).frames()


class _CompositeScene:
    """Specification of one composite."""

    def __init__(self, spec: CompositeSpec, clip: SegmentFootage) -> None:
        self._spec, self._clip = spec, clip
        station = spec.camera.station(clip.view.size_px)
        eye = station.geometry().camera_pose(0.0, 0.0).position_runway_m
        raster = BodyRaster(station, clip.view.blur_px)
        self._painter = LayerPainter(raster, eye, CompositeLight(clip.view.light, spec.sun))
        self._target = _aircraft(spec)
        self._birds = traffic_bodies(TrafficSpec(birds=spec.birds))
        self._heads = spec.camera.heads(clip.view.shifts_px)

    def frames(self) -> Iterator[CompositeFrame]:
        """Yield all frames."""
        for index in range(self._spec.first, self._spec.last + 1):
            yield self._frame(index)

    def _frame(self, index: int) -> CompositeFrame:
        spec, clip = self._spec, self._clip
        place = index - clip.segment.first
        t_s, head = (index - spec.first) / RATE_HZ, self._heads[place]
        target = self._layer(self._target, t_s, head)
        birds = [(bird, layer) for bird in self._birds if (layer := self._layer(bird, t_s, head)) is not None]
        layers = [layer for _, layer in birds] + ([] if target is None else [target])
        generator = np.random.default_rng([spec.seed, _NOISE_STREAM, index])
        picture = layered(clip.frames[place], layers, target, clip.view.noise, generator)
        outlines = [(layer, self._silhouette(bird, layer.exposure)) for bird, layer in birds]
        own = None if target is None else self._silhouette(self._target, target.exposure)
        width, in_view = (0.0, 0.0) if target is None else self._painter.extent(self._target, target.exposure)
        before = [o for layer, o in outlines if o is not None and target is not None and layer.away_m < target.away_m]
        return CompositeFrame(
            index=index,
            t_s=t_s,
            image=picture.image,
            silhouette=own,
            nose_px=None if target is None else target.exposure.pixel_px,
            width_px=width,
            in_view=0.0 if own is None else in_view,
            unhidden=0.0 if own is None else _unhidden(own, before),
            snr=picture.snr,
            over_sky=own is not None and is_sky(sky_mask(clip.frames[place]), own.centre_px),
            real_aircraft=clip.segment.boxes[place],
            birds=tuple(silhouette_box(o) for _, o in outlines if o is not None),
        )

    def _layer(self, body: Body, t_s: float, head: HeadMotion) -> BodyLayer | None:
        return self._painter.layer(body, t_s, head, self._spec.camera.exposure_s)

    def _silhouette(self, body: Body, seen: BodyExposure) -> TrueSilhouette | None:
        """Return what of a body is in the picture."""
        sharp = self._painter.outline(body, seen)
        if sharp is None:
            return None
        mask, (x, y) = crop_mask(sharp.cover[:, :, 3] >= 0.5, sharp.corner, self._clip.view.size_px)
        return TrueSilhouette(x=x, y=y, mask=mask) if mask.size else None


def silhouette_box(silhouette: TrueSilhouette) -> Box[int]:
    """Return the box of a silhouette, whole pixels."""
    height, width = silhouette.mask.shape
    return box_of_size(silhouette.x, silhouette.y, width, height)


def _unhidden(own: TrueSilhouette, nearer: list[TrueSilhouette]) -> float:
    """Return the share of a silhouette that no nearer one hides."""
    left = own.mask.copy()
    for other in nearer:
        both = overlap(left, (own.x, own.y), other.mask, (other.x, other.y))
        if both is not None:
            left[both[0]] &= ~other.mask[both[1]]
    return float(left.sum() / own.mask.sum())


def _aircraft(spec: CompositeSpec) -> AircraftBody:
    """Return the drawn aircraft on its path."""
    airframe = build_airframe(spec.airframe)

    def position(t_s: float) -> FloatArray:
        return np.asarray(spec.path.position(np.array([t_s]))[0])

    def pose(t_s: float) -> AircraftPose:
        return pose_at(spec.path, t_s, airframe.rest_height_m)

    return AircraftBody(airframe=airframe, position=position, pose=pose, casts_shadow=False)
