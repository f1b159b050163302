"""Finding the aircraft in an image: region of interest, level set, regions, target point."""
