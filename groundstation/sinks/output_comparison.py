"""Bitwise comparison of a replay's outputs with those in the recording."""

import json
from dataclasses import dataclass

from groundstation.messages import StepReport
from groundstation.recording.event_codec import line
from groundstation.recording.output_codec import estimate_values, state_values

# limit of outputs that wait for their counterpart; a recorder writes both within a second
_MAX_WAITING = 20_000


@dataclass(frozen=True, slots=True, kw_only=True)
class OutputComparison:
    """Number of outputs compared, number and first epoch of those that differ, and number without a counterpart.

    ``states`` and ``states_differing`` are the same counts for the outputs of heartbeats.
    """

    compared: int
    differing: int
    first_epoch: int | None
    alone: int
    states: int = 0
    states_differing: int = 0

    def line(self) -> str:
        """Return the result as one line of text."""
        if not self.compared:
            return "the recording has no answers to compare with"
        alone = f"; {self.alone} without a counterpart" if self.alone else ""
        if self.states_differing:
            alone = f"; {self.states_differing} of {self.states} answers to heartbeats differ{alone}"
        if not self.differing and not self.states_differing:
            return f"the same track as was recorded, bit for bit: {self.compared} epochs{alone}"
        same = self.compared - self.differing
        first = "" if self.first_epoch is None else f"; the first that differs is epoch {self.first_epoch}"
        return f"not the track that was recorded: {same} of {self.compared} epochs are the same{alone}{first}"


class OutputComparisonSink:
    """A sink that compares each output with the recorded one; the two may arrive in either order."""

    def __init__(self) -> None:
        # by an epoch's number, or a heartbeat's time as text
        self._recorded: dict[int | str, bytes] = {}
        self._answered: dict[int | str, bytes] = {}
        self._compared = self._differing = self._dropped = 0
        self._states = self._states_differing = 0
        self._first: int | None = None

    def recorded(self, answer: bytes) -> None:
        """Add a recorded output, a line of JSON; a damaged one differs from all others."""
        try:
            values = json.loads(answer)
            key = int(values["epoch"]) if "epoch" in values else repr(float(values["t_s"]))
            values.pop("latency_s", None)
        except (ValueError, RecursionError, KeyError, TypeError, AttributeError):
            self._dropped += 1
            return
        self._meet(self._recorded, self._answered, key, line(values))

    def write(self, report: StepReport) -> None:
        """Add the current output."""
        for estimate in report.estimates:
            self._meet(self._answered, self._recorded, int(estimate.epoch), line(estimate_values(estimate)))
        for state in report.states:
            self._meet(self._answered, self._recorded, repr(float(state.t_s)), line(state_values(state)))

    def close(self) -> None:
        """Nothing is held open."""

    def result(self) -> OutputComparison:
        """Return the result of the comparison."""
        alone = len(self._recorded) + len(self._answered) + self._dropped
        return OutputComparison(
            compared=self._compared,
            differing=self._differing,
            first_epoch=self._first,
            alone=alone,
            states=self._states,
            states_differing=self._states_differing,
        )

    def _meet(self, own: dict[int | str, bytes], others: dict[int | str, bytes], key: int | str, text: bytes) -> None:
        other = others.pop(key, None)
        if other is None:
            own[key] = text
            if len(own) > _MAX_WAITING:
                own.pop(next(iter(own)))
                self._dropped += 1
            return
        if isinstance(key, str):
            self._states += 1
            self._states_differing += other != text
            return
        self._compared += 1
        if other != text:
            self._differing += 1
            self._first = key if self._first is None else min(self._first, key)
