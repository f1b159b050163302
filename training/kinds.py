"""Kinds of airframe, scenery and sky: what a window shows, and what a training leaves out."""

from groundstation.simulation.world.world import World


def surroundings_kinds(world: World) -> tuple[str, ...]:
    """Return the scenery and the sky of a world, by name."""
    drawn = (world.scenery.drawn_scenery, world.scenery.drawn_sky)
    return tuple(kind.value for kind in drawn if kind is not None)


def world_kinds(world: World) -> tuple[str, ...]:
    """Return the airframe family of a world, its scenery and its sky, by name."""
    return (world.airframe.family.value, *surroundings_kinds(world))
