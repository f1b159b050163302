"""A connection to a simulated mount in virtual time: no clock, no socket."""

import heapq
import random
from collections.abc import Callable
from itertools import count

from ptu_drivers.errors import LineError
from ptu_drivers.exchange_failed import ExchangeFailed
from ptu_drivers.health import FailureReason
from ptu_drivers.line_lock import SLICE_S, LineLock
from ptu_drivers.simulated.alpaca import SimulatedMount


class VirtualHttp:
    """An `HttpLine` whose other end is simulated.

    Parameters
    ----------
    mount : the other end. seed : of the delays. delay_s : least and most of each way, s.
    """

    def __init__(self, mount: SimulatedMount, seed: int = 0, delay_s: tuple[float, float] = (0.001, 0.004)) -> None:
        self.url = "http://virtual"
        self.lock = LineLock()
        self.mount = mount
        self.dead = False
        """Nothing is answered."""
        self.gone = False
        """Refuse connections."""
        self.trickle_s = 0.0
        """What each byte of an answer takes, s; requests are heard."""
        self._delay_s = delay_s
        self._random = random.Random(seed)
        self._now_s = 0.0
        self._actions: list[tuple[float, int, Callable[[], None]]] = []
        self._order = count()

    def at(self, t_s: float, act: Callable[[], None]) -> None:
        """Do something at an instant, s."""
        heapq.heappush(self._actions, (t_s, next(self._order), act))

    def now(self) -> float:
        """Return the virtual clock, s."""
        return self._now_s

    def wait(self, duration_s: float) -> None:
        """Let virtual time pass."""
        until_s = self._now_s + max(0.0, duration_s)
        while self._actions and self._actions[0][0] <= until_s:
            t_s, _, act = heapq.heappop(self._actions)
            self._now_s = max(self._now_s, t_s)
            act()
        self._now_s = max(self._now_s, until_s)

    def reopen(self) -> None:
        """Open again: nothing is open between requests."""

    def close(self) -> None:
        """Let go."""

    def transfer(self, method: str, path: str, query: str, until_s: float) -> tuple[int, bytes]:
        """Return status and body. Raises ExchangeFailed, LineError."""
        if self.gone:
            raise LineError(self.url, got="connection refused", wanted="an Alpaca server")
        if self.dead:
            self._await(until_s)
            raise ExchangeFailed(FailureReason.TIMEOUT, "no answer")
        self.wait(self._random.uniform(*self._delay_s))
        answer = self.mount.answer(self._now_s, method, path, query)
        back_s = self._random.uniform(*self._delay_s)
        whole_s = self._now_s + back_s + self.trickle_s * len(answer[1])
        if self.trickle_s and whole_s > until_s:
            self._await(until_s)
            raise ExchangeFailed(FailureReason.TIMEOUT, "no whole answer")
        self._await(whole_s)
        return answer

    def _await(self, until_s: float) -> None:
        """Wait as a connection does. Raises ExchangeFailed when a halt has priority."""
        while self._now_s < until_s:
            self.lock.raise_if_preempted()
            self.wait(min(SLICE_S, until_s - self._now_s))
