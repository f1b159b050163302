"""Alt-azimuth mounts behind ASCOM Alpaca."""
