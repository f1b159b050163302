"""Liveries drawn at random, from black to the paleness of the sky."""

import numpy as np

from groundstation.simulation.airframes.livery import LiverySpec
from groundstation.simulation.airframes.mesh import Colour

# BGR in the camera's image in full light
_DARK: tuple[Colour, ...] = (
    (30.0, 30.0, 31.0),  # carbon
    (52.0, 50.0, 50.0),  # dark grey
    (78.0, 44.0, 28.0),  # navy blue
    (42.0, 58.0, 50.0),  # dark green
    (34.0, 30.0, 88.0),  # maroon
)
_BRIGHT: tuple[Colour, ...] = (
    (40.0, 36.0, 168.0),  # red
    (40.0, 110.0, 225.0),  # orange
    (50.0, 190.0, 232.0),  # yellow
    (165.0, 90.0, 36.0),  # blue
    (84.0, 140.0, 64.0),  # green
    (130.0, 160.0, 172.0),  # tan
    (92.0, 120.0, 112.0),  # olive
    (128.0, 126.0, 122.0),  # grey
)
_PALE: tuple[Colour, ...] = (
    (212.0, 214.0, 215.0),  # white
    (188.0, 188.0, 186.0),  # light grey
    (222.0, 202.0, 178.0),  # sky blue
    (214.0, 206.0, 194.0),  # grey of haze
    (196.0, 214.0, 222.0),  # cream
)
_SETS = (_DARK, _BRIGHT, _PALE)
# how often the most of an airframe is dark, bright, pale
_BASE_SHARES = (0.22, 0.3, 0.48)
# a livery of one, two, three colours
_COUNT_SHARES = (0.22, 0.42, 0.36)
_UNDERSIDE_SHARE, _GLOSS = 0.3, 0.06


def draw_livery(generator: np.random.Generator) -> LiverySpec:
    """Return a livery of one, two or three colours, now and then with an underside of its own."""
    tones = [int(generator.choice(3, p=_BASE_SHARES))]
    # a second colour contrasts with the first
    tones.append(int(generator.choice([k for k in range(3) if k != tones[0]])))
    tones.append(int(generator.integers(3)))
    base, second, third = (_colour(generator, _SETS[k]) for k in tones)
    count = 1 + int(generator.choice(3, p=_COUNT_SHARES))
    below = _colour(generator, _SETS[int(generator.integers(3))])
    has_below = count > 1 and generator.random() < _UNDERSIDE_SHARE
    flags = generator.random(7) < (0.65, 0.5, 0.4, 0.5, 0.6, 0.5, 0.3)
    tip, nose = generator.uniform(0.06, 0.35), generator.uniform(0.06, 0.25)
    bands = int(generator.integers(1, 4))
    glass = float(generator.uniform(25.0, 75.0))
    two, three = count > 1, count > 2
    if two and not flags[:4].any():
        flags[0] = True
    return LiverySpec(
        base_bgr=base,
        second_bgr=second if two else base,
        third_bgr=third if three else base,
        underside_bgr=below if has_below else None,
        tip_share=float(tip) if two and flags[0] else 0.0,
        nose_share=float(nose) if two and flags[1] else 0.0,
        painted_tail=bool(two and flags[2]),
        painted_fin=bool(two and flags[3]),
        stripe=bool(three and flags[4]),
        wing_bands=bands if three and (flags[5] or not flags[4]) else 0,
        glass_bgr=(1.1 * glass, glass, 0.9 * glass),
    )


def _colour(generator: np.random.Generator, paints: tuple[Colour, ...]) -> Colour:
    """Return one of the paints, a little lighter, darker or off its hue."""
    paint = np.array(paints[int(generator.integers(len(paints)))])
    drawn = paint * np.exp(generator.normal(0.0, _GLOSS)) * np.exp(generator.normal(0.0, 0.5 * _GLOSS, 3))
    blue, green, red = np.clip(drawn, 8.0, 238.0)
    return float(blue), float(green), float(red)
