"""Rerun recordings read back with Rerun's own reader, row by row."""

import re
from pathlib import Path

import pyarrow as pa
from rerun.chunk import RrdReader


class Recording:
    """A recording read back: the moving and the static columns of each entity, in file order."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.moving: dict[str, list[pa.RecordBatch]] = {}
        self.static: dict[str, list[pa.RecordBatch]] = {}
        reader = RrdReader(path)
        self.blueprints = len(reader.blueprints())
        for chunk in reader.store(store=reader.recordings()[0]).stream():
            kind = self.static if chunk.is_static else self.moving
            kind.setdefault(chunk.entity_path, []).append(chunk.to_record_batch())

    def column(self, entity: str, component: str) -> list[object]:
        """All rows of one component in order of session time, as plain lists."""
        table = pa.Table.from_batches([b.select(["session_time", component]) for b in self.moving[entity]])
        return table.sort_by("session_time").column(component).to_pylist()

    def times_ns(self, entity: str) -> list[int]:
        """The session time of all rows, sorted."""
        return sorted(t for b in self.moving[entity] for t in b.column("session_time").cast(pa.int64()).to_pylist())

    def text(self, entity: str) -> list[str]:
        """The lines of a log."""
        return [row[0] for row in self.column(entity, "TextLog:text")]  # type: ignore[index]


def documented_entities(*, with_site: bool = False) -> set[str]:
    """Return the entities of docs/rerun.md, or those that a replay with a site has besides."""
    page = (Path(__file__).resolve().parents[2] / "docs" / "rerun.md").read_text(encoding="utf-8")
    usual, of_site = page.split("A replay with `--site` has these, too:")
    return set(re.findall(r"^\| `(/[^`]*)` \|", of_site if with_site else usual, flags=re.MULTILINE))
