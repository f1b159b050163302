"""A whole bank: every world scored on the workers, rows and page written."""

import base64
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from groundstation.bank.bank_page import BankResult, bank_page
from groundstation.bank.bank_settings import BankSettings
from groundstation.bank.bank_summary import bank_summary
from groundstation.bank.csrt_process import require_csrt
from groundstation.bank.map_resumable import map_resumable
from groundstation.bank.program_version import identity_of
from groundstation.bank.result_store import write_atomically
from groundstation.bank.result_table import table_hash, write_table
from groundstation.bank.score_world import WorldJob, score_world
from groundstation.errors import InputError
from groundstation.files.new_folder import make_folder
from groundstation.tracking.config import load_config

ROWS, PAGE, SUMMARY = "rows.parquet", "bank.html", "bank.json"
_SESSIONS = "sessions"


@dataclass(frozen=True, slots=True, kw_only=True)
class BankRequest:
    """Parameters of a run of the bank: settings, output folder, workers, tuning file, environment with CSRT.

    ``scheduler`` is the address of a Dask scheduler; None starts ``workers`` processes here (None: one for each core).
    Rendered worlds are kept in ``worlds``, and used again; None keeps none.
    """

    settings: BankSettings
    out: Path
    workers: int | None = None
    scheduler: str | None = None
    config: Path | None = None
    csrt_python: Path | None = None
    worlds: Path | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class BankOutcome:
    """The result, how many of its sessions were found finished, the hash of its table and the files written."""

    result: BankResult
    reused: int
    digest: str
    files: tuple[Path, ...]


def run_bank(
    request: BankRequest, words: str, progress: Callable[[int, int], None] = lambda done, total: None
) -> BankOutcome:
    """Run a bank or go on with it; ``words`` describe the run on the page, ``progress`` counts sessions.

    Sessions that are finished in ``out`` with the same program and settings are not run again. Raises `InputError` for
    a tuning file that cannot be used or a Python without CSRT, `MissingExtraError` without Dask.
    """
    settings, tuning = request.settings, None
    if request.config is not None:
        load_config(request.config)
        tuning = request.config.read_text(encoding="utf-8")
    if request.csrt_python is not None:
        require_csrt(request.csrt_python)
    if request.worlds is not None:
        make_folder(request.worlds)
    jobs = {
        f"world-{seed}": WorldJob(
            seed=seed,
            duration_s=settings.duration_s,
            frame_hz=settings.frame_hz,
            tuning=tuning,
            csrt_python=None if request.csrt_python is None else str(request.csrt_python.absolute()),
            worlds=None if request.worlds is None else str(request.worlds.absolute()),
        )
        for seed in settings.seeds
    }
    how = json.dumps([settings.duration_s, settings.frame_hz, tuning, request.csrt_python is not None])
    outcome = map_resumable(
        score_world,
        jobs,
        request.out / _SESSIONS,
        request.workers,
        request.scheduler,
        settings=how,
        limit_s=settings.limit_s,
        progress=progress,
    )
    if not outcome.results:
        first = outcome.failures[0]
        raise InputError("bank", got=f"no session that ended, {first.name}: {first.reason}", wanted="at least one")
    rows = [found.value["row"] for found in outcome.results]
    result = BankResult(
        settings=settings,
        rows=rows,
        sheets={int(found.value["row"]["seed"]): base64.b64decode(found.value["sheet"]) for found in outcome.results},
        failures=outcome.failures,
    )
    digest = table_hash(rows)
    summary = bank_summary(settings, rows, outcome.failures, digest, program=identity_of(score_world, how))
    files = _write(request.out, result, words, summary)
    return BankOutcome(result=result, reused=outcome.reused, digest=digest, files=files)


def _write(out: Path, result: BankResult, words: str, summary: dict[str, Any]) -> tuple[Path, ...]:
    """Write table, summary and page; returns their paths."""
    write_table(out / ROWS, result.rows)
    text = json.dumps(summary, indent=1, ensure_ascii=False) + "\n"
    write_atomically(out / SUMMARY, lambda draft: draft.write_text(text, encoding="utf-8"))
    html = bank_page(result, words)
    write_atomically(out / PAGE, lambda draft: draft.write_text(html, encoding="utf-8"))
    return out / ROWS, out / SUMMARY, out / PAGE
