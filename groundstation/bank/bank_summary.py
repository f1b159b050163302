"""bank.json: what a bank's page shows, for programs."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from groundstation.bank.bank_page import worst_rows
from groundstation.bank.bank_settings import BankSettings
from groundstation.bank.dispatcher import JobFailure
from groundstation.bank.factor_figures import factor_figures
from groundstation.bank.pooled_figures import POOLED, distributions, pooled
from groundstation.bank.result_table import Row

SUMMARY_FORMAT = "groundstation-bank-summary/1"


def bank_summary(
    settings: BankSettings, rows: Sequence[Row], failures: Sequence[JobFailure], digest: str, *, program: str | None
) -> dict[str, Any]:
    """Return settings, pooled figures, distributions, factors and the worst seeds.

    ``digest`` is of the rows, ``program`` of the program and its tuning, None where that is not known.
    """
    figures = [pooled(rows, ratio) for ratio in POOLED]
    return {
        "format": SUMMARY_FORMAT,
        "settings": {**asdict(settings), "world_set": settings.world_set.value},
        "program": program,
        "sessions": len(rows),
        "failed": [{"name": f.name, "kind": f.kind.value, "reason": f.reason} for f in failures],
        "sha256": digest,
        "pooled": [
            {"title": f.ratio.title, "value": f.value, "low": f.low, "high": f.high, "sessions": f.sessions}
            for f in figures
        ],
        "distributions": [asdict(found) for found in distributions(rows)],
        "factors": [asdict(figures) for figures in factor_figures(rows)],
        "worst": [int(row["seed"]) for row in worst_rows(rows, settings.worst)],
    }
