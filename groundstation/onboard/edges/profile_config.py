"""Tuning of the profile across an edge."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class ProfileConfig:
    """Tuning of the profile.

    Attributes
    ----------
    blocks : of rows along an edge.
    wide, fine : displacements of the line to either side, first with steps of twice the size.
    beside : steps of the profile at either side of the trials.
    least_step_px, step_m : a step at a row is the larger of the two.
    lines_m : positions of the outer side of a painted side line, outwards from the edge, None for none. The first is
        used until another is confirmed: the middle of the range of ICAO's Annex 14 (5.2.7, about on the edge).
    line_width_m, wide_line_width_m : its width, and on runways of 30 m and more, as there.
    lamps_m : positions of lamps, outwards from the edge, None for none. The first is used until another
        is confirmed, in the dark the second; Annex 14 (5.3.9) has them within 3 m.
    lamp_height_m : of lamps; elevated runway edge lights are 0.3 to 0.36 m high, and therefore appear farther out.
    line_cost, lamps_cost : least log-likelihood gain of a line and lamps in a picture.
    dim_cost : and in addition where its brightness is not significant.
    layout_margin : summed gain at which other positions of line and lamps are adopted.
    layout_alike, layout_alike_stated : nats of that which count as one against what is known before any picture, and
        for the covariance: errors of pictures are correlated. Of a clip of another renderer whose width was announced
        0.75 to 0.85 times as wide, both edges 1.7 m too far in, 17, 13 and 10 of 36 frames were beyond three sigmas
        with 8, 7, 8 and none with 12, none with 16; of 757 frames that track in train 0-29 and 500000-500029 three
        with 8, one with 16.
    untried_m : displacement of the lines by a layout that was never compared, outwards.
    merged_share, merged_m : probability of a side line as bright as ground that is brighter than the pavement, where
        the ground is not as white as paint, and how far inside the edge such a line's outer side is.
    least_evidence : log-likelihood of an edge over none at all below which it is not seen.
    picture_limit : most log-likelihood by which a picture tells two layouts apart.
    shape_margin : summed gain at which the line is taken as wider, narrower or elsewhere by a step.
    lamps_alone : log-probability of lamps without a side line before any picture, against the other layouts.
    layout_outlier : where layouts are compared, likelihood of a block that is an outlier, over the best of all layouts.
    least_spread, paint_spread, light_spread, mark_least : departure of a block's excess from that of the whole mark, of
        this: at least, and at most that of a line and of lamps; and at least in all.
    announced_m : the runway's width as announced; None: any is as likely.
    layouts, layouts_beside : number compared in a picture, and where other pairs are tracked too.
    outwards_m, apart_m : displacement of both edges with another layout, and of each separately.
    stray_steps, stray_cost : distance of other lines with the same layout, in wide steps, and their least gain of
        log-likelihood in a picture.
    blur_px : sigma of the picture across a line.
    mark_sigma, mark_frames : deviation of the excess (0 to 1) of paint and lamps from the usual one, and the
        number of frames of its average.
    values_as_one : number of a profile's values (bins in steps of the fine size, three colours) whose errors are equal
        and that count as one in its likelihood: a pixel's noise is in two bins of half a pixel; of three colours that
        share light and texture the errors are between one and three; two times two.
    floor_px, stated_floor_px : lower limit of an end's sigma: as it weighs against other pictures, whose errors are
        much alike, and as it is stated.
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
    line_cost: float = 1.0
    lamps_cost: float = 1.0
    dim_cost: float = 2.0
    layout_margin: float = 12.0
    layout_alike: float = 4.0
    layout_alike_stated: float = 16.0
    untried_m: float = 0.5
    merged_share: float = 0.25
    merged_m: float = 0.45
    least_evidence: float = 15.0
    picture_limit: float = 30.0
    shape_margin: float = 10.0
    lamps_alone: float = -3.25
    layout_outlier: float = 1e-4
    least_spread: float = 0.2
    paint_spread: float = 0.5
    light_spread: float = 0.7
    mark_least: float = 0.02
    announced_m: float | None = None
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
    stated_floor_px: float = 0.15
