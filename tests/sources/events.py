"""Reading a session folder to its end, and what came of it."""

from dataclasses import dataclass, field
from pathlib import Path

from groundstation.errors import InputError
from groundstation.messages import Epoch, Event, Frame, PixelMeasurement, PtuSample
from groundstation.session import load_session
from groundstation.sources.folder_source import FolderSource
from tests.session.folder import number_of


@dataclass
class Played:
    events: list[Event] = field(default_factory=list)
    fault: str = ""

    @property
    def frames(self) -> list[Frame]:
        return [e for e in self.events if isinstance(e, Frame)]

    @property
    def epochs(self) -> list[Epoch]:
        return [e for e in self.events if isinstance(e, Epoch)]

    @property
    def readings(self) -> list[PtuSample]:
        return [e for e in self.events if isinstance(e, PtuSample)]

    @property
    def pixels(self) -> list[PixelMeasurement]:
        return [e for e in self.events if isinstance(e, PixelMeasurement)]

    def delivered_frames(self, station: str) -> list[Frame]:
        return [f for f in self.frames if f.station == station]

    def check_order(self) -> None:
        """Stamps never go back; an epoch follows the last of its frames, and comes once."""
        newest = float("-inf")
        seen: dict[int, list[float]] = {}
        for event in self.events:
            if isinstance(event, Epoch):
                stamps = seen.pop(event.epoch)
                assert event.t_s == sum(stamps) / len(stamps)
                assert max(stamps) == newest
                continue
            assert event.t_s >= newest
            newest = event.t_s
            if isinstance(event, Frame):
                seen.setdefault(event.epoch, []).append(event.t_s)
        assert not seen or self.fault

    def check_pictures(self) -> None:
        """Each picture is the one that frames.csv means."""
        for frame in self.frames:
            assert number_of(frame.image.whole()) == frame.epoch


def play(folder: Path, from_s: float | None = None, to_s: float | None = None) -> Played:
    played = Played()
    try:
        with FolderSource(load_session(folder), from_s, to_s) as source:
            for event in source:
                played.events.append(event)
    except InputError as fault:
        played.fault = str(fault)
    assert played.fault.isprintable()
    return played
