"""Where the heads turn: the pointing law, the search pattern, and zones that are kept out of."""
