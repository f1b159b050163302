"""Tuning of the profile across an edge."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class ProfileConfig:
    """Tuning of the profile.

    Attributes
    ----------
    blocks : of rows along an edge.
    wide, fine : displacements of the line to either side that are tried, first with steps of twice the size.
    beside : steps at either side of the trials that the profile goes on.
    least_step_px, step_m : a step at a row is the larger of the two.
    lines_m : where the outer side of a painted side line may be, outwards from the edge, None for none. The first is
        taken until something else is seen: the middle of what ICAO's Annex 14 (5.2.7, about on the edge) leaves.
    line_width_m, wide_line_width_m : its width, and on runways of 30 m and more, as there.
    lamps_m : where lamps may stand, outwards from the edge, None for none. The first of these is taken until something
        else is seen, in the dark the second; Annex 14 (5.3.9) has them within 3 m.
    lamp_height_m : of lamps; elevated runway edge lights are 0.3 to 0.36 m high, and seen farther out for it.
    line_cost, lamps_cost : log-likelihood that a line and lamps have to be worth in a picture.
    dim_cost : and beyond that where it is no brighter than chance.
    layout_margin : over that in all, before other places of line and lamps are taken.
    layout_alike : how many nats of that are one, for what is stated: pictures err alike.
    untried_m : what a layout that was never compared may put the lines apart, outwards.
    layouts, layouts_beside : compared in a picture with the one that is held, and where other pairs are followed too.
    outwards_m, apart_m : how much farther out or in both edges may be with another layout, and each on its own.
    stray_steps, stray_cost : how far off other lines with the same layout are, in wide steps, and what they have to
        be likelier by in a picture.
    blur_px : sigma of the picture across a line.
    mark_sigma, mark_frames : what the excess (0 to 1) of paint and lamps may differ by from what is usual, and over
        how many frames that is taken.
    values_as_one : so many of a profile's values (bins in steps of the fine size, three colours) err as one, and count
        as one in its likelihood: a pixel's noise is in two bins of half a pixel, and of three colours that share light
        and texture the errors are between one and three; two times two.
    floor_px : sigma that no end goes below.
    """

    blocks: int = 8
    wide: int = 12
    fine: int = 6
    beside: int = 11
    least_step_px: float = 0.5
    step_m: float = 0.12
    lines_m: tuple[float | None, ...] = (-0.5, None, 0.0, -0.25, -0.75, -1.0)
    line_width_m: float = 0.45
    wide_line_width_m: float = 0.9
    lamps_m: tuple[float | None, ...] = (None, 1.0, 1.5, 2.0, 2.5, 3.0)
    lamp_height_m: float = 0.3
    line_cost: float = 40.0
    lamps_cost: float = 40.0
    dim_cost: float = 150.0
    layout_margin: float = 20.0
    layout_alike: float = 4.0
    untried_m: float = 0.5
    layouts: int = 6
    layouts_beside: int = 3
    outwards_m: float = 1.5
    apart_m: float = 0.25
    stray_steps: float = 4.0
    stray_cost: float = 5.0
    blur_px: float = 0.8
    mark_sigma: float = 0.04
    mark_frames: int = 10
    values_as_one: float = 4.0
    floor_px: float = 0.4
