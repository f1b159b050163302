"""The rate at which a machine can render a simulated station's pictures and still find an aircraft in them."""

FULL_RATE_HZ = 30.0
# below, an aircraft is not found and held for sure: at 2 pairs/s it was tracked in 65 % of the pairs; next to ten other
# programs, at 1, in 2 %
FEWEST_PAIRS_HZ = 3.0
_RATES_HZ = (FULL_RATE_HZ, 25.0, 20.0, 15.0, 12.0, 10.0, 8.0, 6.0, 5.0, 4.0, 3.0, 2.0, 1.0)
# of the time in which all cameras of a pair could be rendered one pair after the other; what is left is the pipeline's,
# the recorder's and the screen's. Two idle cores, 1280 × 960: at 30 pairs/s a third of the pictures came too late, and
# the aircraft was tracked in 37 % of the answered pairs; at 20 in 59 to 79 %, at 15 and below in 86 to 90 %
_RENDERING_SHARE = 0.3
# a search with so many looks per s, measured alone, finds an aircraft although pairs are dropped; a slower one has to
# keep up with the pictures. Two cores next to two other programs that compute (6 looks per s, half of it in operation):
# at 5 pairs/s the aircraft was not found in 40 s, at 3 late, at 2 it was tracked in 65 % of the pairs
_SLOW_LOOKS_HZ, _FAST_LOOKS_HZ, _SEARCHING_SHARE = 7.0, 11.0, 0.28


def sustainable_rate_hz(pair_s: float, search_s: float) -> float:
    """Return the rate in pairs per s where rendering a pair takes ``pair_s`` and searching one ``search_s``, s."""
    most_hz = _RENDERING_SHARE / max(pair_s, 1e-6)
    looks_hz = 1.0 / max(search_s, 1e-6)
    # from keeping up with a slow search to no limit by a fast one
    slow_hz = _SEARCHING_SHARE * looks_hz
    share = min(max((looks_hz - _SLOW_LOOKS_HZ) / (_FAST_LOOKS_HZ - _SLOW_LOOKS_HZ), 0.0), 1.0)
    most_hz = min(most_hz, slow_hz ** (1.0 - share) * FULL_RATE_HZ**share)
    return next((rate for rate in _RATES_HZ if rate <= most_hz), _RATES_HZ[-1])
