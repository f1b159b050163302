"""Flights drawn at random: what is flown, how it is drawn, and the trajectory with its own attitude."""

from groundstation.simulation.drawn_flights.drawn_flight import DrawnFlight, build_flight
from groundstation.simulation.drawn_flights.flight_draw import draw_flight
from groundstation.simulation.drawn_flights.flight_spec import CircuitSide, FlightKind, FlightSpec

__all__ = ["CircuitSide", "DrawnFlight", "FlightKind", "FlightSpec", "build_flight", "draw_flight"]
