"""How often a second something happened lately."""

from collections import deque

# over so long it is taken
OVER_S = 5.0


class RecentRate:
    """Rate of a count over the last seconds, from its values at intervals."""

    def __init__(self) -> None:
        self._seen: deque[tuple[float, int]] = deque()

    def at(self, now_s: float, count: int) -> float:
        """Note a count; return how much it grew a second lately, 0 at the first."""
        seen = self._seen
        seen.append((now_s, count))
        while len(seen) > 2 and seen[0][0] < now_s - OVER_S:
            seen.popleft()
        (from_s, before), (to_s, after) = seen[0], seen[-1]
        return (after - before) / (to_s - from_s) if to_s > from_s else 0.0
