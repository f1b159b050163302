"""A camera's lens from pictures of a board."""
