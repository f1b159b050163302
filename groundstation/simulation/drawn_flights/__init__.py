"""Flights drawn at random: manoeuvres, their draw, and the trajectory with its own attitude."""

from groundstation.simulation.drawn_flights.drawn_flight import DrawnFlight, build_flight
from groundstation.simulation.drawn_flights.flight_draw import draw_flight
from groundstation.simulation.drawn_flights.flight_spec import DRAWN_KINDS, CircuitSide, FlightKind, FlightSpec
from groundstation.simulation.drawn_flights.way_point import WayPoint

__all__ = [
    "DRAWN_KINDS",
    "CircuitSide",
    "DrawnFlight",
    "FlightKind",
    "FlightSpec",
    "WayPoint",
    "build_flight",
    "draw_flight",
]
