"""A panorama of the ground around each head, from pictures that the head itself takes."""
