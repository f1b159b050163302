"""All that moves in a world but the aircraft that is followed, as plain numbers."""

import math
from dataclasses import dataclass
from enum import StrEnum

from groundstation.simulation.airframes.spec import AirframeSpec
from groundstation.simulation.parameter_checks import require, require_finite, require_within
from groundstation.simulation.scenery.light import require_colour
from groundstation.simulation.scenery.surfaces import Colour, GroundPatch, Surface
from groundstation.simulation.traffic.arc_path import ArcPath
from groundstation.simulation.traffic.bird_spec import BirdSpec, FlockSpec

_SLOWEST_M_S = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class OtherAircraftSpec:
    """Another aircraft: its airframe, and the path of its nose."""

    airframe: AirframeSpec
    path: ArcPath


class CarKind(StrEnum):
    """Kind of a vehicle on a road."""

    CAR = "car"
    ESTATE = "estate"
    VAN = "van"


@dataclass(frozen=True, slots=True, kw_only=True)
class CarSpec:
    """A car on a road, in its own right lane.

    Attributes
    ----------
    kind : its shape.
    length_m, width_m, height_m : its size.
    colour_bgr : its paint.
    along_m : where its middle is at time 0, along the road from the road's middle.
    speed_m_s : along the road; negative drives against the road's heading. Parked cars are objects of the scenery.
    """

    kind: CarKind = CarKind.CAR
    length_m: float = 4.4
    width_m: float = 1.8
    height_m: float = 1.5
    colour_bgr: Colour = (150.0, 152.0, 154.0)
    along_m: float = 0.0
    speed_m_s: float = 12.0

    def __post_init__(self) -> None:
        require_within(
            self,
            {
                "length_m": (2.0, 12.0),
                "width_m": (1.0, 3.0),
                "height_m": (1.0, 4.0),
                "speed_m_s": (-60.0, 60.0),
            },
        )
        wanted = f"{_SLOWEST_M_S:g} m/s or more, either way"
        require(abs(self.speed_m_s) >= _SLOWEST_M_S, "CarSpec: speed_m_s", got=self.speed_m_s, wanted=wanted)
        require_finite("CarSpec: along_m", self.along_m)
        require_colour("CarSpec: colour_bgr", self.colour_bgr)


@dataclass(frozen=True, slots=True, kw_only=True)
class RoadSpec:
    """A straight road with what drives on it.

    Attributes
    ----------
    surface : its material.
    x_m, y_m : its middle, runway frame.
    heading_rad : of its length, from +y towards +x.
    length_m, width_m : its size.
    cars : on it.
    """

    surface: Surface = Surface.ASPHALT
    x_m: float
    y_m: float
    heading_rad: float = 0.0
    length_m: float
    width_m: float = 5.5
    cars: tuple[CarSpec, ...] = ()

    def __post_init__(self) -> None:
        require_within(self, {"width_m": (2.0, 40.0)})
        # the patch checks the rest
        self.patch()

    def patch(self) -> GroundPatch:
        """Return the road as a patch of the ground."""
        return GroundPatch(
            surface=self.surface,
            x_m=self.x_m,
            y_m=self.y_m,
            heading_rad=self.heading_rad,
            length_m=self.length_m,
            width_m=self.width_m,
        )

    def car_path(self, car: CarSpec) -> ArcPath:
        """Return the path of the middle of a car on the ground."""
        forward = math.copysign(1.0, car.speed_m_s)
        sine, cosine = math.sin(self.heading_rad), math.cos(self.heading_rad)
        right = forward * 0.25 * self.width_m
        return ArcPath(
            place_m=(
                self.x_m + car.along_m * sine + right * cosine,
                self.y_m + car.along_m * cosine - right * sine,
                0.0,
            ),
            heading_rad=self.heading_rad + (0.0 if forward > 0.0 else math.pi),
            speed_m_s=abs(car.speed_m_s),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class TrafficSpec:
    """Moving objects of a world; none by default."""

    birds: tuple[BirdSpec, ...] = ()
    flocks: tuple[FlockSpec, ...] = ()
    aircraft: tuple[OtherAircraftSpec, ...] = ()
    roads: tuple[RoadSpec, ...] = ()


def traffic_kind(traffic: TrafficSpec) -> str:
    """Return ``none``, ``birds``, ``aircraft``, ``cars`` or ``mixed``."""
    found = {
        "birds": bool(traffic.birds or traffic.flocks),
        "aircraft": bool(traffic.aircraft),
        "cars": any(road.cars for road in traffic.roads),
    }
    kinds = [name for name, there in found.items() if there]
    if len(kinds) > 1:
        return "mixed"
    return kinds[0] if kinds else "none"
