"""Real birds flown over real clips of aircraft: the birds cut out, their flights, and the tracker's results."""
