"""Store of finished results: one small file each, written atomically, so that an interrupted run can be resumed."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from groundstation.files.output_names import below
from groundstation.files.whole_file import whole_file

RESULT_FORMAT = "groundstation-result/1"
_IDENTITY_CHARACTERS = 12


@dataclass(frozen=True, slots=True, kw_only=True)
class JobResult:
    """Result of one job: plain JSON values; wall time and processor time, s."""

    name: str
    value: Any
    elapsed_s: float
    cpu_s: float


class ResultStore:
    """Results in a folder, of one identity (`program_version.identity_of`).

    Results of other identities stay where they are and are not read.
    """

    def __init__(self, folder: Path, identity: str) -> None:
        self.folder = folder
        self._identity = identity

    def find(self, name: str) -> JobResult | None:
        """Return a finished result; None where there is none, or a damaged one."""
        try:
            content = json.loads(self._path(name).read_text(encoding="utf-8"))
            if (content["format"], content["identity"], content["name"]) != (RESULT_FORMAT, self._identity, name):
                return None
            return JobResult(
                name=name,
                value=content["value"],
                elapsed_s=float(content["elapsed_s"]),
                cpu_s=float(content["cpu_s"]),
            )
        except (OSError, ValueError, KeyError, TypeError, RecursionError):
            return None

    def write(self, result: JobResult) -> None:
        """Write a result, on the disk before its name is there."""
        content = {
            "format": RESULT_FORMAT,
            "identity": self._identity,
            "name": result.name,
            "value": result.value,
            "elapsed_s": result.elapsed_s,
            "cpu_s": result.cpu_s,
        }
        text = json.dumps(content, ensure_ascii=False)
        write_atomically(self._path(result.name), lambda path: path.write_text(text, encoding="utf-8"))

    def _path(self, name: str) -> Path:
        return below(self.folder, f"{name}-{self._identity[:_IDENTITY_CHARACTERS]}.json")


def write_atomically(path: Path, write: Callable[[Path], object]) -> None:
    """Write a file under another name, sync it, and give it its own: a reader finds all of it or the file before."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as draft:
        write(draft)
