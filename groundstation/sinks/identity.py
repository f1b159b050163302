"""Whether a replayed recording answers what was answered when it was recorded, to the last bit."""

import json
from dataclasses import dataclass

from groundstation.messages import StepReport
from groundstation.recording.answer_codec import estimate_values
from groundstation.recording.event_codec import line

# as many answers as may wait for their counterpart; a recorder writes both within a second
_MAX_WAITING = 20_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Identity:
    """How many answers were compared, how many differ and from which epoch on, and how many have no counterpart."""

    compared: int
    differing: int
    first_epoch: int | None
    alone: int

    def line(self) -> str:
        """Return it as one line for a person."""
        if not self.compared:
            return "the recording has no answers to compare with"
        alone = f"; {self.alone} without a counterpart" if self.alone else ""
        if not self.differing:
            return f"the same track as was recorded, bit for bit: {self.compared} epochs{alone}"
        same = self.compared - self.differing
        return f"not the track that was recorded: {same} of {self.compared} epochs are the same{alone}; " + (
            f"the first that differs is epoch {self.first_epoch}"
        )


class IdentitySink:
    """A sink that compares each answer with the recorded one, whichever comes first."""

    def __init__(self) -> None:
        self._recorded: dict[int, bytes] = {}
        self._answered: dict[int, bytes] = {}
        self._compared = self._differing = self._dropped = 0
        self._first: int | None = None

    def recorded(self, answer: bytes) -> None:
        """Take a recorded answer, a line of JSON; one that is damaged differs from all others."""
        try:
            values = json.loads(answer)
            epoch = int(values["epoch"])
            values.pop("latency_s", None)
        except (ValueError, RecursionError, KeyError, TypeError, AttributeError):
            self._dropped += 1
            return
        self._meet(self._recorded, self._answered, epoch, line(values))

    def write(self, report: StepReport) -> None:
        """Take what was answered now."""
        for estimate in report.estimates:
            self._meet(self._answered, self._recorded, int(estimate.epoch), line(estimate_values(estimate)))

    def close(self) -> None:
        """Nothing is held open."""

    def result(self) -> Identity:
        """Return what came of it."""
        alone = len(self._recorded) + len(self._answered) + self._dropped
        return Identity(compared=self._compared, differing=self._differing, first_epoch=self._first, alone=alone)

    def _meet(self, own: dict[int, bytes], others: dict[int, bytes], epoch: int, text: bytes) -> None:
        other = others.pop(epoch, None)
        if other is None:
            own[epoch] = text
            if len(own) > _MAX_WAITING:
                own.pop(next(iter(own)))
                self._dropped += 1
            return
        self._compared += 1
        if other != text:
            self._differing += 1
            self._first = epoch if self._first is None else min(self._first, epoch)
