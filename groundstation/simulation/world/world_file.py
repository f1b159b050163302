"""world.toml: a world as a readable file that can be edited and rendered again."""

from pathlib import Path

from groundstation.errors import ConfigError
from groundstation.files.toml_table import TomlTable, load_toml
from groundstation.simulation.specification_table import read_specification, specification_table, toml_text
from groundstation.simulation.world.world import World

FILE_NAME = "world.toml"
FORMAT = "groundstation-world/1"


def world_text(world: World) -> str:
    """Return a world as the text of world.toml."""
    return toml_text({"format": FORMAT, **specification_table(world)}) + "\n"


def load_world(path: Path) -> World:
    """Read a world; raises `ConfigError` with file, table and key of the first mistake."""
    document = load_toml(path, ConfigError)
    TomlTable(document, str(path), ConfigError).choice("format", [FORMAT])
    del document["format"]
    return read_specification(World, TomlTable(document, str(path), ConfigError))
