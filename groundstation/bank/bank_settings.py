"""BANK.toml: which worlds a bank draws, and how each is scored."""

from dataclasses import dataclass
from pathlib import Path

from groundstation.errors import ConfigError
from groundstation.files.toml_table import TomlTable, load_toml
from groundstation.simulation.drawn_flights.flight_spec import LONGEST_S, SHORTEST_S
from groundstation.simulation.parameter_checks import require, require_positive
from groundstation.simulation.specification_table import read_specification
from groundstation.simulation.world.draw_world import DURATION_S, FRAME_HZ
from groundstation.simulation.world.world_sets import SEEDS_PER_SET, WorldSet, seed_of

FORMAT = "groundstation-bank/1"


@dataclass(frozen=True, slots=True, kw_only=True)
class BankSettings:
    """Settings of a bank; two runs with the same settings have the same worlds.

    Attributes
    ----------
    world_set : train, validate or test.
    sessions : number of worlds.
    first : number of the first world within its set.
    duration_s, frame_hz : of each session.
    limit_s : longest time of one session on a worker, s; one that takes longer is reported as failed.
    worst : number of sessions that the page shows with pictures.
    """

    world_set: WorldSet
    sessions: int
    first: int = 0
    duration_s: float = DURATION_S
    frame_hz: float = FRAME_HZ
    limit_s: float = 3600.0
    worst: int = 10

    def __post_init__(self) -> None:
        most = SEEDS_PER_SET - self.first
        require(0 <= self.first < SEEDS_PER_SET, "first", got=self.first, wanted=f"0 to {SEEDS_PER_SET - 1}")
        require(1 <= self.sessions <= most, "sessions", got=self.sessions, wanted=f"1 to {most}")
        require(self.worst >= 0, "worst", got=self.worst, wanted="a whole number ≥ 0")
        for name in ("duration_s", "frame_hz", "limit_s"):
            require_positive(name, getattr(self, name))
        within = SHORTEST_S <= self.duration_s <= LONGEST_S
        require(within, "duration_s", got=self.duration_s, wanted=f"from {SHORTEST_S:g} to {LONGEST_S:g}")

    @property
    def seeds(self) -> tuple[int, ...]:
        """Seeds of the worlds, ascending."""
        return tuple(seed_of(self.world_set, self.first + k) for k in range(self.sessions))


def load_bank_settings(path: Path) -> BankSettings:
    """Read BANK.toml; raises `ConfigError` with file and key of the first mistake."""
    document = load_toml(path, ConfigError)
    TomlTable(document, str(path), ConfigError).choice("format", [FORMAT])
    del document["format"]
    return read_specification(BankSettings, TomlTable(document, str(path), ConfigError))
