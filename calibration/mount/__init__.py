"""How a camera sits on its pan-tilt head, from sightings at known angles."""
