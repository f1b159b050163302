"""The runs of a comparison: their kinds and names, and the replay of those without results."""

import os
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from groundstation.errors import InputError
from groundstation.files.output_names import below
from groundstation.files.overwriting import Output, refuse_overwriting
from groundstation.replay.replay import ReplayRequest, replay
from groundstation.replay.result_files import REPLAY_FILES
from groundstation.session.load import LIVE_RECORDING

RECORDING = "session.rrd"
SUMMARY = "summary.json"
TRACK = "track.csv"
# the recording in a live run's output folder
_WANTED = "a session folder, a recording (.mcap), a replay's output folder or its session.rrd"


class SourceKind(StrEnum):
    """Kind of a source: a session to replay, the results of a replay, or a Rerun recording."""

    SESSION = "session"
    RESULTS = "results"
    RERUN = "rerun"


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedRun:
    """One run: unique name, source, and the tuning it is replayed with, if any."""

    name: str
    source: Path
    kind: SourceKind
    config: Path | None = None


def source_kind(path: Path) -> SourceKind:
    """Return the kind of a path; raises `InputError` if it is none of these."""
    if path.is_dir():
        if (path / "session.toml").is_file() or (path / "rig.toml").is_file():
            return SourceKind.SESSION
        if _live_recording(path) is not None:
            return SourceKind.SESSION
        if any((path / name).is_file() for name in (RECORDING, SUMMARY, TRACK)):
            return SourceKind.RESULTS
        raise InputError(str(path), got="neither session.toml nor track.csv in it", wanted=_WANTED)
    if not path.exists():
        raise InputError(str(path), got="no such file or folder", wanted=_WANTED)
    kinds = {".rrd": SourceKind.RERUN, ".mcap": SourceKind.SESSION}
    if path.suffix.lower() not in kinds:
        raise InputError(str(path), got=f"a file {path.suffix or 'without an ending'}", wanted=_WANTED)
    return kinds[path.suffix.lower()]


def _live_recording(path: Path) -> Path | None:
    """Return the recording in a live run's folder; None for any other folder."""
    replayed = any((path / name).is_file() for name in (RECORDING, SUMMARY))
    return path / LIVE_RECORDING if not replayed and (path / LIVE_RECORDING).is_file() else None


def plan_runs(sources: Sequence[Path], configs: Sequence[Path] = ()) -> list[PlannedRun]:
    """Return the runs of some sources, each session once with every tuning.

    A name is that of the folder or file, made unique by the parent folder's name or a number. Raises `InputError` for
    a path that is no run, or for a tuning together with the results of a replay.
    """
    plain: list[tuple[str, Path, SourceKind, Path | None]] = []
    for source, name in zip(sources, _source_names(sources), strict=True):
        kind = source_kind(source)
        if configs and kind is not SourceKind.SESSION:
            got = "results of a replay"
            raise InputError(str(source), got=got, wanted="a session: --config sets how it is replayed")
        for config in configs or (None,):
            if config is not None and not config.is_file():
                raise InputError(str(config), got="no such file", wanted="a tuning, TOML")
            suffix = "" if config is None else _plain(config.stem)
            full = name if not suffix else suffix if len(sources) == 1 else f"{name}-{suffix}"
            plain.append((full, _live_recording(source) or source, kind, config))
    names = _unique([name for name, *_ in plain])
    return [
        PlannedRun(name=name, source=source, kind=kind, config=config)
        for name, (_, source, kind, config) in zip(names, plain, strict=True)
    ]


def refuse_replay_overwriting(
    read: Iterable[Path | None], runs: Sequence[PlannedRun], work: Path, more: Sequence[Output] = ()
) -> None:
    """Raise `InputError` if a replay into ``work``, or an output in ``more``, would overwrite an input.

    The output folders depend on the names of the runs, so this follows `plan_runs`.
    """
    folders = [below(work, run.name) for run in runs if run.kind is SourceKind.SESSION]
    refuse_overwriting(read, [*(Output(path=folder, names=REPLAY_FILES) for folder in folders), *more])


def run_results(
    run: PlannedRun,
    work: Path,
    *,
    rig: Path | None = None,
    rerun: bool,
    smooth: bool = False,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> tuple[Path, InputError | None]:
    """Return the folder of a run's results, replaying a session into ``work``/name, and the fault that ended it."""
    if run.kind is not SourceKind.SESSION:
        return (run.source if run.source.is_dir() else run.source.parent), None
    out = below(work, run.name)
    request = ReplayRequest(session=run.source, out=out, rig=rig, config=run.config, rerun=rerun, smooth=smooth)
    return out, replay(request, progress).fault


def _source_names(sources: Sequence[Path]) -> list[str]:
    """Return a name for each source; equal ones include the parent folder."""
    parts = [_name_parts(source) for source in sources]
    short = [p[-1] for p in parts]
    return [
        "-".join(p[-2:]) if short.count(name) > 1 and len(p) > 1 else name for name, p in zip(short, parts, strict=True)
    ]


def _name_parts(source: Path) -> list[str]:
    """Return the last two parts of a path as names; a session.rrd has the name of its folder."""
    whole = Path(os.path.realpath(source))
    if whole.is_file():
        whole = whole.parent if whole.name == RECORDING else whole.with_suffix("")
    return [_plain(part) for part in whole.parts[-2:] if part.strip("/\\")] or ["run"]


def _unique(names: Sequence[str]) -> list[str]:
    """Append a number to repeated names, from the second on."""
    found: list[str] = []
    for name in names:
        unique, number = name, 2
        while unique in found:
            unique, number = f"{name}-{number}", number + 1
        found.append(unique)
    return found


def _plain(text: str) -> str:
    """Return a name of letters, digits, - and _, valid in file names and entity paths."""
    return re.sub(r"[^\w-]+", "-", text).strip("-") or "run"
