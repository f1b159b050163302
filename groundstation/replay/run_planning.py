"""Several runs to set side by side: which there are, what they are called, and replaying those that are not yet."""

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

RECORDING = "session.rrd"
SUMMARY = "summary.json"
TRACK = "track.csv"
# what a live run leaves beside its tables
LIVE_RECORDING = "flight.mcap"
_WANTED = "a session folder, a recording (.mcap), a replay's output folder or its session.rrd"


class SourceKind(StrEnum):
    """What an argument is: something to replay, the results of a replay, or a Rerun recording."""

    SESSION = "session"
    RESULTS = "results"
    RERUN = "rerun"


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedRun:
    """One run: its name, unlike any other's; where it comes from; the tuning it is replayed with, if any."""

    name: str
    source: Path
    kind: SourceKind
    config: Path | None = None


def source_kind(path: Path) -> SourceKind:
    """Return what a path is; raises `InputError` if it is none of these."""
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
    """Return the recording of a live run's folder, which is to be replayed; None for any other folder."""
    replayed = any((path / name).is_file() for name in (RECORDING, SUMMARY))
    return path / LIVE_RECORDING if not replayed and (path / LIVE_RECORDING).is_file() else None


def plan_runs(sources: Sequence[Path], configs: Sequence[Path] = ()) -> list[PlannedRun]:
    """Return the runs of some sources, each session once with every tuning.

    Names are those of the folders or files, a folder further up or a number where two would be alike. Raises
    `InputError` for what is no run, or has been replayed already and so takes no tuning.
    """
    plain: list[tuple[str, Path, SourceKind, Path | None]] = []
    for source, name in zip(sources, _source_names(sources), strict=True):
        kind = source_kind(source)
        if configs and kind is not SourceKind.SESSION:
            got = "results of a replay"
            raise InputError(str(source), got=got, wanted="a session: --config says how it is to be replayed")
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
    """Raise `InputError` where what is replayed into ``work``, or ``more`` that is written, would replace what is read.

    Which folders a command makes there is not known before its runs are.
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
    """Return the folder of a run's results, replaying a session into ``work``/name, and the fault that cut it short."""
    if run.kind is not SourceKind.SESSION:
        return (run.source if run.source.is_dir() else run.source.parent), None
    out = below(work, run.name)
    request = ReplayRequest(session=run.source, out=out, rig=rig, config=run.config, rerun=rerun, smooth=smooth)
    return out, replay(request, progress).fault


def _source_names(sources: Sequence[Path]) -> list[str]:
    """Return a name for each source, longer where short ones are alike."""
    parts = [_name_parts(source) for source in sources]
    short = [p[-1] for p in parts]
    return [
        "-".join(p[-2:]) if short.count(name) > 1 and len(p) > 1 else name for name, p in zip(short, parts, strict=True)
    ]


def _name_parts(source: Path) -> list[str]:
    """Return the last folders of a path, its own name last; a session.rrd is called as its folder is."""
    whole = source.resolve()
    if whole.is_file():
        whole = whole.parent if whole.name == RECORDING else whole.with_suffix("")
    return [_plain(part) for part in whole.parts[-2:] if part.strip("/\\")] or ["run"]


def _unique(names: Sequence[str]) -> list[str]:
    """Number names that are alike, from the second on."""
    found: list[str] = []
    for name in names:
        unique, number = name, 2
        while unique in found:
            unique, number = f"{name}-{number}", number + 1
        found.append(unique)
    return found


def _plain(text: str) -> str:
    """Return a name of letters, digits, - and _, as file names and entity paths take it."""
    return re.sub(r"[^\w-]+", "-", text).strip("-") or "run"
