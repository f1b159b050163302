"""How soon a process that was lost is begun again: at once, then after 1, 2, 4 and 8 s, and every 8 s from then on."""

_FIRST_S, _LONGEST_S = 1.0, 8.0
# a process that was well for so long begins at the front
_WELL_S = 60.0


class RestartDelay:
    """Counts restarts, and gives the time to wait before each."""

    def __init__(self) -> None:
        self.restarts = 0
        self._next_s = 0.0
        self._began_s = 0.0

    def began(self, now_s: float) -> None:
        """Note that the process began its work."""
        self._began_s = now_s

    def lost(self, now_s: float) -> float:
        """Note that it was lost; returns when it may be begun again."""
        if now_s - self._began_s > _WELL_S:
            self._next_s = 0.0
        due_s = now_s + self._next_s
        self._next_s = min(max(2.0 * self._next_s, _FIRST_S), _LONGEST_S)
        self.restarts += 1
        # a process that never gets to its work again is not well meanwhile
        self._began_s = due_s
        return due_s
