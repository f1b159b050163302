"""A far end that answers what a test says: for answers that no simulated unit gives."""

from collections.abc import Callable

from ptu_drivers.transport import BITS_PER_CHARACTER


class ScriptedPeer:
    """Calls `answer(bytes so far)` after each byte; what it returns is sent after `delay_s`, and the bytes forgotten.

    Attributes
    ----------
    heard : all bytes that came.
    """

    def __init__(self, answer: Callable[[bytes], bytes | None], baud: int = 9600, delay_s: float = 0.004) -> None:
        self.answer = answer
        self.delay_s = delay_s
        self.heard = bytearray()
        self._character_s = BITS_PER_CHARACTER / baud
        self._baud = baud
        self._typed = bytearray()
        self._out: list[tuple[float, int, int]] = []

    def connect(self, t_s: float) -> None:
        pass

    def say(self, t_s: float, data: bytes) -> None:
        for i, byte in enumerate(data, start=1):
            self._out.append((t_s + i * self._character_s, byte, self._baud))
        self._out.sort(key=lambda item: item[0])

    def receive(self, t_s: float, byte: int, baud: int) -> None:
        self.heard.append(byte)
        self._typed.append(byte)
        reply = self.answer(bytes(self._typed))
        if reply is not None:
            self._typed.clear()
            self.say(t_s + self.delay_s, reply)

    def send(self, until_s: float) -> list[tuple[float, int, int]]:
        sent = [item for item in self._out if item[0] <= until_s]
        self._out = [item for item in self._out if item[0] > until_s]
        return sent

    def next_s(self) -> float:
        return self._out[0][0] if self._out else float("inf")
