"""Targets filmed in train worlds: on the ground and before it, with shadows, behind posts, as a station's camera shows.

Drawn windows (`training.windows`) have real backgrounds and any light; these have the aircraft where it truly flies and
rolls, and everything that surrounds it there. Each picture also gives a window elsewhere, at its busiest place of some:
a plain sky teaches little.
"""

import math
from collections.abc import Iterator

import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.bank.session_truth import LEAST_WIDTH_PX
from groundstation.detection.learned_channel import LearnedChannel
from groundstation.simulation.drawn_flights import build_flight
from groundstation.simulation.world.render_world import built_stations, rendered_cameras
from groundstation.simulation.world.world import World
from groundstation.sources.true_silhouettes import TrueSilhouette
from training.filming import LabelledShot, as_coded, film_badly_aimed, filming_moment, is_visible
from training.kinds import world_kinds
from training.mined_places import false_place
from training.recorded_windows import LabelledPicture, RecordedTarget, target_in

# of so many places the busiest is a window, too
_PLACES = 6
# logarithm of the width that is expected of an aircraft where a bird is, over the bird's; and the largest such width
_BIRD_LOG_RATIO = (-0.3, 2.0)
_MOST_WIDTH_PX = 260.0


def filmed_targets(
    world: World, pictures: int, generator: np.random.Generator, channel: LearnedChannel | None = None
) -> Iterator[RecordedTarget]:
    """Film a world at so many drawn moments; yield each visible target, and a place without one expected there.

    A bird in the picture is a place, too, and a ``channel`` adds, where there is one, what it takes for an aircraft.
    """
    flown = build_flight(world.flight, world.seed)
    cameras = list(rendered_cameras(world, built_stations(world), flown).values())
    kinds = world_kinds(world)
    for _ in range(pictures):
        camera = cameras[int(generator.integers(len(cameras)))]
        t_s = filming_moment(flown, camera, generator)
        filmed = film_badly_aimed(camera, t_s, flown.position(np.array([t_s]))[0], generator)
        if filmed is not None and is_visible(filmed.shot):
            yield from _targets(filmed, kinds, generator, channel)


def _targets(
    filmed: LabelledShot, kinds: tuple[str, ...], generator: np.random.Generator, channel: LearnedChannel | None
) -> Iterator[RecordedTarget]:
    truth, image = filmed.shot.truth, filmed.shot.picture.whole()
    image = as_coded(image, generator)
    picture = LabelledPicture(image=image, cover=filmed.cover, other=filmed.other)
    silhouette = TrueSilhouette(x=truth.corner_px[0], y=truth.corner_px[1], mask=truth.silhouette)
    unknown = np.full(2, np.nan)
    nose = unknown if truth.pixel_px is None else truth.pixel_px
    middle, width = silhouette.centre_px, truth.width_px
    yield target_in(picture, middle, width, nose, kinds)
    yield target_in(picture, _busiest(image, width, generator), width, nose, kinds, around_target=False)
    if filmed.bird_boxes:
        bird = filmed.bird_boxes[int(generator.integers(len(filmed.bird_boxes)))]
        place, wide = np.array([bird.x0 + bird.x1 - 1, bird.y0 + bird.y1 - 1]) / 2.0, float(bird.x1 - bird.x0)
        # as wide as an aircraft that is expected there
        wide = min(max(wide * math.exp(float(generator.uniform(*_BIRD_LOG_RATIO))), LEAST_WIDTH_PX), _MOST_WIDTH_PX)
        yield target_in(picture, place, wide, nose, kinds, around_target=False)
    if channel is None:
        return
    mistaken = false_place(channel, image, np.maximum(filmed.cover, filmed.other), generator)
    if mistaken is not None:
        yield target_in(picture, *mistaken, nose, kinds, around_target=False)


def _busiest(image: ImageArray, width_px: float, generator: np.random.Generator) -> FloatArray:
    """Return the point (2,) of some whose surroundings, as large as a target, vary most."""
    size = np.array(image.shape[1::-1])
    places = generator.uniform(0.0, 1.0, (_PLACES, 2)) * (size - 1)
    half = max(width_px, 8.0)

    def contrast(place: FloatArray) -> float:
        x0, y0 = np.maximum(place - half, 0.0).astype(int)
        x1, y1 = np.minimum(place + half, size).astype(int) + 1
        return float(image[y0:y1, x0:x1].std())

    return np.asarray(max(places, key=contrast))
