"""Training of the learned channel: windows drawn from the bank's worlds and real clips, a small network, its weights.

Needs groundstation[train]; neither running nor testing the program needs it.
"""
