"""Order of a station's packed array (36,): `station` fills it, compiled kernels read it."""

RUNWAY_FROM_BASE = 0  # (9,), row-major
PTU_POSITION = 9  # (3,) m, runway frame
HEAD_FROM_CAMERA = 12  # (9,), row-major
CAMERA_IN_HEAD = 21  # (3,) m
FX, FY, CX, CY = 24, 25, 26, 27  # px
LENS, LENS_END = 28, 34  # k1, k2, p1, p2, k3 and the largest r² at which the polynomial is used
RADIUS_LIMIT = 33
COS_LEAN, SIN_LEAN = 34, 35  # of the angle by which the tilt axis leans out of the plane across the pan axis
