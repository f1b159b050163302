"""A world: everything that a rendered session depends on, as plain values."""

from collections.abc import Iterator
from dataclasses import dataclass, field

from groundstation.simulation.airframes.spec import AirframeSpec
from groundstation.simulation.drawn_cameras import CameraSpec
from groundstation.simulation.drawn_flights import FlightSpec
from groundstation.simulation.drawn_stations import StationsSpec
from groundstation.simulation.parameter_checks import require, require_positive
from groundstation.simulation.scenery import Scenery
from groundstation.simulation.traffic import TrafficSpec, traffic_kind

# spans by which results are grouped, m
_SPAN_CLASSES = ((1.8, "below 1.8 m"), (3.0, "1.8 to 3 m"), (4.5, "3 to 4.5 m"))
_HAZE_CLASSES = ((3000.0, "below 3 km"), (8000.0, "3 to 8 km"))
# of Koschmieder's law: the visual range is where contrast has fallen to 2 %
_VISUAL_RANGE_PER_EXTINCTION = 3.912


@dataclass(frozen=True, slots=True, kw_only=True)
class World:
    """Parameters of a rendered session; the same world gives the same session, bit for bit.

    Attributes
    ----------
    seed : of the random draws during rendering: noise, gusts, encoder errors, lost frames.
    frame_hz : pairs per s.
    airframe, flight, scenery : the aircraft, its flight and the surroundings.
    traffic : what else moves.
    stations : positions, heads, clocks and calibration; ``cameras`` one for each, in this order.
    """

    seed: int
    frame_hz: float = 10.0
    airframe: AirframeSpec
    flight: FlightSpec
    scenery: Scenery = field(default_factory=Scenery)
    traffic: TrafficSpec = field(default_factory=TrafficSpec)
    stations: StationsSpec
    cameras: tuple[CameraSpec, ...]

    def __post_init__(self) -> None:
        require(self.seed >= 0, "World: seed", got=self.seed, wanted="a whole number ≥ 0")
        require_positive("World: frame_hz", self.frame_hz)
        stations, cameras = len(self.stations.stations), len(self.cameras)
        require(cameras == stations, "World: cameras", got=cameras, wanted=f"{stations}, one for each station")


def world_factors(world: World) -> dict[str, str]:
    """Return the conditions of a world by name, each as the class that results are grouped by."""
    return dict(_factors(world))


def _factors(world: World) -> Iterator[tuple[str, str]]:
    scenery, camera = world.scenery, world.cameras[0]
    yield "airframe", world.airframe.family.value
    yield "span", _class(world.airframe.span_m, _SPAN_CLASSES, "above 4.5 m")
    yield "flight", world.flight.kind.value
    yield "scenery", "unnamed" if scenery.drawn_scenery is None else scenery.drawn_scenery.value
    yield "sky", "unnamed" if scenery.drawn_sky is None else scenery.drawn_sky.value
    yield "traffic", traffic_kind(world.traffic)
    visual_range = _VISUAL_RANGE_PER_EXTINCTION * scenery.haze.extinction_m
    yield "visual range", _class(visual_range, _HAZE_CLASSES, "above 8 km")
    yield "stations", str(len(world.stations.stations))
    yield "picture", f"{camera.image_size_px[0]} x {camera.image_size_px[1]}"
    yield "sensor", "colour" if camera.colour else "grey"
    yield "shutter", "rolling" if camera.readout_s else "global"
    yield "coding", camera.coding.value
    yield "exposure", _class(camera.exposure_s, ((0.002, "below 2 ms"), (0.005, "2 to 5 ms")), "above 5 ms")
    yield "focus", "defocused" if max(c.defocus_px for c in world.cameras) > 1.0 else "sharp"


def _class(value: float, edges: tuple[tuple[float, str], ...], last: str) -> str:
    """Return the name of a value's class, the first with a greater edge."""
    return next((name for edge, name in edges if value < edge), last)
