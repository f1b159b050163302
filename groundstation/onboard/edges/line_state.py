"""Order of a line state (4,) or (7,): two lines on the ground, as in `lines`, and the pose's lasting errors.

The lines are a·x + b·y + c = 0 and a·x + b·y + d = 0; the tracker's own state also carries the errors of roll and
pitch, rad, and of height, m.
"""

A, B, C, D, ROLL, PITCH, UP = 0, 1, 2, 3, 4, 5, 6
