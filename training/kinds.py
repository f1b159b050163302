"""Kinds of airframe, scenery and sky: what a window shows, and what a training leaves out."""

from groundstation.simulation.world.world import World


def surroundings_kinds(world: World) -> tuple[str, ...]:
    """Return the scenery and the sky of a world, by name."""
    drawn = (world.scenery.drawn_scenery, world.scenery.drawn_sky)
    return tuple(kind.value for kind in drawn if kind is not None)


def world_kinds(world: World) -> tuple[str, ...]:
    """Return the airframe families of a world, the target's first, its scenery and its sky, by name.

    Other aircraft in the air are labelled as aircraft, too, and a network is not to learn them from a kind left out.
    """
    families = [world.airframe.family, *(each.airframe.family for each in world.traffic.aircraft)]
    return (*dict.fromkeys(family.value for family in families), *surroundings_kinds(world))
