"""What of a rig is possible, but seldom meant: said in a replay's notes."""

from groundstation.rig.rig import Rig

# so close to the picture's corner, as a share of its size, a principal point is likely counted from the middle
_CORNER_SHARE = 0.05
# lenses and sensors have square pixels to some per cent; a picture of single fields, or a squeezed one, has not
_MOST_OBLONG = 1.2


def rig_notes(rig: Rig) -> list[str]:
    """Return a note on each station's lens that is unusual."""
    notes = []
    for station in rig.stations:
        lens = station.lens
        middle, size = lens.principal_point_px, lens.image_size_px
        where = f"{rig.path}: station {station.name}"
        if all(abs(float(m)) <= _CORNER_SHARE * s for m, s in zip(middle, size, strict=True)):
            notes.append(
                f"{where}: principal_point_px {middle[0]:g}, {middle[1]:g} is at the upper left corner of the picture, "
                "from which it is counted, and not from the middle"
            )
        ratio = float(lens.focal_px.max() / lens.focal_px.min())
        if ratio > _MOST_OBLONG:
            notes.append(
                f"{where}: focal_px {lens.focal_px[0]:g}, {lens.focal_px[1]:g}: pixels {ratio:.2f} times as long "
                "as wide are rare, unless the picture is squeezed"
            )
    return notes
