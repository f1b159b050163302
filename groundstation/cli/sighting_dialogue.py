"""The dialogue of `groundstation calibrate sightings`: a typed line is a turn, a look, a pixel, or where to go on."""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from groundstation.cli.sighting_recorder import SightingRecorder
from groundstation.errors import GroundstationError, InputError

HELP = """  go            turn to where the landmark is expected
  PAN TILT      turn to these angles, deg
  by PAN TILT   turn by so much, deg; arrow keys, then Enter: by a step each
  step DEG      length of that step (now {step:g})
  look [U V]    write a picture, and the part about a pixel enlarged, to pick from
  at U V        the mark's centre is at this pixel: record the stop
  same          find the mark by its earlier picture, and record the stop
  next [NAME]   the next landmark, or this one
  list          what has been recorded
  end           leave; all that was recorded is saved"""
_ARROWS = {"A": (0, 1), "B": (0, -1), "C": (-1, 0), "D": (1, 0)}
# as terminals send them, cursor or application mode
_ARROW = re.compile(r"\x1b[\[O]([ABCD])")
_MAX_ARROWS = 200
_MAX_DEG = 720.0
FIRST_STEP_DEG = 0.1


class Verb(StrEnum):
    """What a typed line asks for."""

    GO = "go"
    TURN = "turn"
    BY = "by"
    ARROWS = "arrows"
    STEP = "step"
    LOOK = "look"
    AT = "at"
    SAME = "same"
    NEXT = "next"
    LIST = "list"
    HELP = "help"
    END = "end"
    NOTHING = "nothing"


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """A typed line: its verb, its numbers (deg, px or steps), and a landmark's name after `next`."""

    verb: Verb
    numbers: tuple[float, ...] = ()
    name: str = ""


# how many numbers may follow
_COUNTS = {Verb.BY: (2,), Verb.STEP: (1,), Verb.LOOK: (0, 2), Verb.AT: (2,)}
_WORDS = {v.value: v for v in Verb if v not in (Verb.TURN, Verb.ARROWS, Verb.NOTHING)}
_ALSO = {"quit": Verb.END, "exit": Verb.END, "?": Verb.HELP}


def parse_line(text: str) -> Line:
    """Return what a line asks for; raises `InputError` where it is none of `HELP`."""
    arrows = _ARROW.findall(text)
    if arrows:
        if _ARROW.sub("", text).strip() or len(arrows) > _MAX_ARROWS:
            raise InputError("the line", got="arrows and something else", wanted=f"1 to {_MAX_ARROWS} arrows alone")
        steps = np.sum([_ARROWS[a] for a in arrows], axis=0)
        return Line(verb=Verb.ARROWS, numbers=(float(steps[0]), float(steps[1])))
    first, _, rest = text.strip().partition(" ")
    if not first:
        return Line(verb=Verb.NOTHING)
    verb = _WORDS.get(first.lower(), _ALSO.get(first.lower()))
    if verb is Verb.NEXT:
        return Line(verb=verb, name=rest.strip())
    if verb is None:
        return Line(verb=Verb.TURN, numbers=_numbers(text, (2,)))
    return Line(verb=verb, numbers=_numbers(rest, _COUNTS.get(verb, (0,))))


def _numbers(text: str, counts: tuple[int, ...]) -> tuple[float, ...]:
    words = text.replace(",", " ").split()
    try:
        found = tuple(float(word) for word in words)
    except ValueError:
        found = (math.nan,)
    if len(found) not in counts or not all(math.isfinite(v) and abs(v) < 1e6 for v in found):
        wanted = " or ".join(f"{n} number{'s' if n != 1 else ''}" if n else "nothing more" for n in counts)
        raise InputError("the line", got=repr(text.strip()[:60]), wanted=f"{wanted}, or a word that `help` lists")
    return found


class SightingDialogue:
    """Goes through the landmarks of one station with a user.

    Parameters
    ----------
    ask : shows a prompt and returns the typed line; raises `EOFError` at the end of the input.
    tell : called with each line for the user.
    """

    def __init__(self, recorder: SightingRecorder, ask: Callable[[str], str], tell: Callable[[str], None]) -> None:
        self._recorder, self._ask, self._tell = recorder, ask, tell
        self._names = list(recorder.landmarks)
        self._step_deg = FIRST_STEP_DEG
        # one that has rows is not asked for again, so that an interrupted session goes on where it was
        left = [name for name in self._names if not recorder.rows_of(name)]
        self._name = left[0] if left else self._names[0]

    def run(self) -> None:
        """Ask and act until the user ends it; faults are told, and it goes on."""
        self._list()
        self._introduce()
        while True:
            try:
                text = self._ask(f"{self._recorder.station.name} {self._name}> ")
            except EOFError:
                return
            try:
                line = parse_line(text)
                if line.verb is Verb.END:
                    return
                self._act(line)
            except GroundstationError as fault:
                self._tell(str(fault))

    def _act(self, line: Line) -> None:
        if line.verb in (Verb.GO, Verb.TURN, Verb.BY, Verb.ARROWS):
            self._turn(line)
        elif line.verb is Verb.STEP:
            self._set_step(line.numbers[0])
        elif line.verb is Verb.LOOK:
            self._recorder.look(self._name, np.array(line.numbers) if line.numbers else None)
        elif line.verb in (Verb.AT, Verb.SAME):
            if line.verb is Verb.AT:
                self._recorder.record_picked(self._name, np.array(line.numbers))
            else:
                self._recorder.record_same(self._name)
            self._go_on()
        elif line.verb is Verb.NEXT:
            self._go_on(line.name)
        elif line.verb is Verb.LIST:
            self._list()
        elif line.verb is Verb.HELP:
            self._tell(HELP.format(step=self._step_deg))

    def _turn(self, line: Line) -> None:
        if line.verb is Verb.GO:
            expected = self._recorder.expected(self._name)
            if expected is None:
                wanted = (
                    "angles typed as PAN TILT: it was not seen before, and the rig does not know the station's pose"
                )
                raise InputError(self._name, got="no expected angles", wanted=wanted)
            pan, tilt = (float(a) for a in expected.angles_rad)
        elif line.verb is Verb.TURN:
            if max(map(abs, line.numbers)) > _MAX_DEG:
                raise InputError("the line", got=f"angles {line.numbers}", wanted=f"at most {_MAX_DEG:g} deg")
            pan, tilt = (math.radians(v) for v in line.numbers)
        else:
            length_deg = self._step_deg if line.verb is Verb.ARROWS else 1.0
            here = self._recorder.station.angles()
            pan, tilt = (float(a) + math.radians(length_deg * v) for a, v in zip(here, line.numbers, strict=True))
        self._recorder.turn_to(pan, tilt)

    def _set_step(self, step_deg: float) -> None:
        if not 0.0 < step_deg <= 30.0:
            raise InputError("step", got=f"{step_deg:g} deg", wanted="above 0, up to 30")
        self._step_deg = step_deg

    def _go_on(self, name: str = "") -> None:
        if name and name not in self._names:
            raise InputError("next", got=name, wanted=f"one of {', '.join(self._names[:12])}")
        self._name = name or self._names[(self._names.index(self._name) + 1) % len(self._names)]
        self._introduce()

    def _introduce(self) -> None:
        """Tell where the landmark is expected, and what can be done about it."""
        expected = self._recorder.expected(self._name)
        rows = self._recorder.rows_of(self._name)
        text = f"{self._name}: {rows} rows; "
        if not self._recorder.station.turns:
            text += "the station is fixed: look"
        elif expected is None:
            text += "turn to it by PAN TILT or arrow keys, then look"
        else:
            pan, tilt = np.degrees(expected.angles_rad)
            text += f"expected at pan {pan:+.3f}, tilt {tilt:+.3f} deg, {expected.source}: go, then look"
        if self._recorder.knows(self._name):
            text += " or same"
        self._tell(text)

    def _list(self) -> None:
        counts = [self._recorder.rows_of(name) for name in self._names]
        self._tell(f"{sum(1 for n in counts if n)} of {len(counts)} landmarks recorded; help lists what can be typed")
        for name, rows in zip(self._names, counts, strict=True):
            if rows:
                self._tell(f"  {name}: {rows} rows")
