"""Systems that run on the aircraft's own camera; nothing in the ground chain imports them."""
