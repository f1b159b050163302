"""A folder in which the commands of the pages are run as they are shown there, each once."""

import hashlib
import json
import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from pages.passages import ROOT

_PROGRAM = ("groundstation", "calibration", "ptu_drivers")
_CODE = (".py", ".onnx", ".js")
_RECORD = "ran.json"


@dataclass(frozen=True, slots=True, kw_only=True)
class Ran:
    """What a command printed, and its exit status."""

    out: str
    err: str
    status: int


class Workshop:
    """Runs commands in one folder; what a command has left there is used again while the program is the same.

    Parameters
    ----------
    folder : where; made if it is not there. `recordings` and `docs` in it are the project's.
    prepare : writes the inputs of a name below the folder (the `run in` of a page's block).
    """

    def __init__(self, folder: Path, prepare: Callable[[Path, str], None]) -> None:
        self.folder = folder
        self._prepare = prepare
        folder.mkdir(parents=True, exist_ok=True)
        for name in ("recordings", "docs"):
            if not (folder / name).exists():
                (folder / name).symlink_to(ROOT / name)
        self._program = _program_hash()
        self._ran = self._read()

    def run(self, command: str, where: str = ".", status: int = 0) -> Ran:
        """Run a command of the pages, `groundstation …`, in the folder ``where``; the exit status has to be this.

        Raises
        ------
        RuntimeError
            If it ends with another status.
        """
        key = f"{where}: {command}"
        if key not in self._ran:
            if where != "." and not (self.folder / where).exists():
                self._prepare(self.folder, where)
            self._remove(self.folder / where, written(shlex.split(command)))
            print(f"… {command}", file=sys.stderr, flush=True)
            words = [sys.executable, "-m", "groundstation", *shlex.split(command)[1:]]
            environment = os.environ | {"PYTHONPATH": str(ROOT)}
            # of a terminal's width where there is none
            environment.pop("COLUMNS", None)
            done = subprocess.run(
                words, cwd=self.folder / where, env=environment, capture_output=True, text=True, check=False
            )
            if done.returncode != status:
                raise RuntimeError(f"{command}: exit status {done.returncode}, wanted {status}: {done.stderr[-500:]}")
            self._ran[key] = Ran(out=done.stdout, err=done.stderr, status=done.returncode)
            self._write()
        return self._ran[key]

    def _remove(self, where: Path, name: str | None) -> None:
        """Remove what another program, or a run that was cut short, has left where a command writes."""
        left = None if name is None else where / name
        if left is not None and left.exists() and self.folder.resolve() in left.resolve().parents:
            shutil.rmtree(left)

    def _read(self) -> dict[str, Ran]:
        path = self.folder / _RECORD
        if not path.is_file():
            return {}
        document = json.loads(path.read_text(encoding="utf-8"))
        if document["program"] != self._program:
            return {}
        return {key: Ran(**ran) for key, ran in document["ran"].items()}

    def _write(self) -> None:
        document = {"program": self._program, "ran": {key: asdict(ran) for key, ran in self._ran.items()}}
        (self.folder / _RECORD).write_text(json.dumps(document, indent=1), encoding="utf-8")


def written(words: Sequence[str]) -> str | None:
    """Return the folder that a command's words name as its output."""
    return words[words.index("--out") + 1] if "--out" in words else None


def _program_hash() -> str:
    """Return a hash of the program's files."""
    total = hashlib.sha256()
    for package in _PROGRAM:
        for file in sorted((ROOT / package).rglob("*")):
            if file.suffix in _CODE:
                total.update(str(file.relative_to(ROOT)).encode() + file.read_bytes())
    return total.hexdigest()
