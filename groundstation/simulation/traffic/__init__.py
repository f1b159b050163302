"""Traffic: birds, other aircraft and cars that move through a scene.

`draw_traffic` draws a `TrafficSpec`, plain numbers; `traffic_bodies` and `with_roads` build what a scene shows of it.
"""

from groundstation.simulation.traffic.build import traffic_bodies, with_roads
from groundstation.simulation.traffic.draw import draw_traffic
from groundstation.simulation.traffic.traffic_spec import TrafficSpec, traffic_kind

__all__ = ["TrafficSpec", "draw_traffic", "traffic_bodies", "traffic_kind", "with_roads"]
