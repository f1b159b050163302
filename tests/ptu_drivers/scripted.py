"""A far end with scripted replies: for replies that no simulated unit gives."""

from collections.abc import Callable

from ptu_drivers.simulated.peer import SimulatedPeer


class ScriptedPeer(SimulatedPeer):
    """Calls `answer(bytes so far)` after each byte; the result is sent after `delay_s`, and the bytes discarded.

    Attributes
    ----------
    heard : all received bytes.
    """

    def __init__(self, answer: Callable[[bytes], bytes | None], baud: int = 9600, delay_s: float = 0.004) -> None:
        super().__init__(baud=baud)
        self.answer = answer
        self.delay_s = delay_s
        self.heard = bytearray()
        self._typed = bytearray()

    def _take(self, t_s: float, byte: int) -> None:
        self.heard.append(byte)
        self._typed.append(byte)
        reply = self.answer(bytes(self._typed))
        if reply is not None:
            self._typed.clear()
            self.say(t_s + self.delay_s, reply)

    def _lose_power(self, t_s: float, off_s: float, *, homing: bool) -> float:
        return t_s + off_s
