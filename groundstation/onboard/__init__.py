"""The systems that run on the aircraft's own camera; nothing of the ground chain imports them."""

"""Systems that run on the aircraft's own camera; nothing in the ground chain knows them."""
