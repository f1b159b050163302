"""What a laboratory brings home, turned into a session folder: videos, a table of angles, a log of positions."""
