"""Ground as bright as pavement or brighter, and what borders on it: salt, pale sand, chalk, bleached and frosted grass.

In drawn worlds snow is in the test set alone. What it has in common with these, an edge of little contrast next to
borders of more, is to be learnt from them.
"""

import math

import numpy as np

from groundstation.onboard.scenes.ground import Colour, Strip

BRIGHT = {
    "salt": ((0.66, 0.65, 0.62), (0.80, 0.79, 0.77)),
    "pale sand": ((0.56, 0.50, 0.40), (0.72, 0.66, 0.55)),
    "chalk": ((0.58, 0.57, 0.53), (0.74, 0.73, 0.69)),
    "bleached grass": ((0.48, 0.44, 0.30), (0.62, 0.57, 0.43)),
    "frosted grass": ((0.46, 0.50, 0.46), (0.64, 0.67, 0.66)),
}
BRIGHT_SHARES = dict.fromkeys(BRIGHT, 1.0)
SURFACE_SHARES = {"asphalt": 0.3, "concrete": 0.5, "graded": 0.2}
# a graded runway's reflectance over that of the ground it is made of
_GRADED = (0.8, 1.15)
# of what is blown or grown over a runway, the share that is ground: none, some or most of it
_SOME, _MOST = (0.2, 0.6), (0.6, 0.9)
_BORDER_SHARES = {"none": 0.25, "ploughed": 0.25, "track": 0.25, "trees": 0.25}
_TREES: Colour = (0.07, 0.09, 0.05)


def blown_over(generator: np.random.Generator) -> float:
    """Return the share of a runway's surface that the ground covers."""
    return float(generator.choice([0.0, generator.uniform(*_SOME), generator.uniform(*_MOST)]))


def graded(generator: np.random.Generator, ground: Colour) -> Colour:
    """Return the reflectance of a runway that is made of the ground."""
    by = float(generator.uniform(*_GRADED))
    red, green, blue = (min(by * one, 0.95) for one in ground)
    return red, green, blue


def borders(generator: np.random.Generator, width_m: float, ground: Colour) -> tuple[str, tuple[Strip, ...]]:
    """Return what lies along a runway, in a word, and as strips on one side of it or on both."""
    kind = list(_BORDER_SHARES)[int(generator.choice(len(_BORDER_SHARES), p=list(_BORDER_SHARES.values())))]
    sides = [(-1.0,), (1.0,), (-1.0, 1.0), (-1.0, 1.0)][int(generator.integers(4))]
    if kind == "none":
        return kind, ()
    found = []
    turn = float(generator.normal(0.0, 0.03))
    tone = float(generator.uniform(0.45, 0.85))
    for side in sides:
        gap = {"ploughed": (2.0, 20.0), "track": (4.0, 25.0), "trees": (12.0, 60.0)}[kind]
        wide = {"ploughed": (15.0, 120.0), "track": (2.5, 6.0), "trees": (4.0, 12.0)}[kind]
        width, away = (float(generator.uniform(*one)) for one in (wide, gap))
        colour, dashes = _toned(ground, tone), (0.0, 1.0)
        if kind == "trees":
            colour, dashes = _TREES, (float(generator.uniform(7.0, 20.0)), float(generator.uniform(0.5, 0.95)))
        found.append(
            Strip(
                x_m=side * (0.5 * width_m + away + 0.5 * width),
                y_m=float(generator.uniform(-150.0, 50.0)),
                turn_rad=turn,
                width_m=width,
                length_m=float(np.exp(generator.uniform(math.log(400.0), math.log(3000.0)))),
                colour=colour,
                mottle=float(generator.uniform(0.1, 0.4)),
                dashes=dashes,
            )
        )
    return kind, tuple(found)


def _toned(colour: Colour, by: float) -> Colour:
    red, green, blue = (by * one for one in colour)
    return red, green, blue
