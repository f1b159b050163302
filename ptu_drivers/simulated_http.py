"""A connection to a simulated mount in virtual time: no clock, no socket."""

import random

from ptu_drivers.doubtful import Doubtful
from ptu_drivers.errors import LineError
from ptu_drivers.health import DoubtReason
from ptu_drivers.simulated_alpaca import SimulatedMount


class VirtualHttp:
    """An `HttpLine` whose other end is simulated.

    Parameters
    ----------
    mount : the other end. seed : of the delays. delay_s : least and most of each way, s.
    """

    def __init__(self, mount: SimulatedMount, seed: int = 0, delay_s: tuple[float, float] = (0.001, 0.004)) -> None:
        self.url = "http://virtual"
        self.mount = mount
        self.dead = False
        """Nothing is answered."""
        self.gone = False
        """Nobody listens."""
        self._delay_s = delay_s
        self._random = random.Random(seed)
        self._now_s = 0.0

    def now(self) -> float:
        """Return the virtual clock, s."""
        return self._now_s

    def wait(self, duration_s: float) -> None:
        """Let virtual time pass."""
        self._now_s += max(0.0, duration_s)

    def reopen(self) -> None:
        """Open again: nothing is open between requests."""

    def close(self) -> None:
        """Let go."""

    def transfer(self, method: str, path: str, query: str, until_s: float) -> tuple[int, bytes]:
        """Return status and body. Raises Doubtful, LineError."""
        if self.gone:
            raise LineError(self.url, got="connection refused", wanted="an Alpaca server")
        if self.dead:
            self._now_s = max(self._now_s, until_s)
            raise Doubtful(DoubtReason.TIMEOUT, "no answer")
        self.wait(self._random.uniform(*self._delay_s))
        answer = self.mount.answer(self._now_s, method, path, query)
        self.wait(self._random.uniform(*self._delay_s))
        return answer
