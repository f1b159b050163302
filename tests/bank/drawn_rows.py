"""Rows of a bank made up from a seed, in the shape that `score_world` gives them."""

from typing import Any

import numpy as np

from groundstation.bank.frame_classes import FRAME_FACTORS, class_column

FIRST_SEED = 1_000_000


def drawn_row(
    number: int, *, visible: int = 100, hit: int = 90, sky: str = "clear", airframe: str = "glider"
) -> dict[str, Any]:
    """Return the row of one session; its frames are all of the first class of each frame factor."""
    row: dict[str, Any] = {
        "seed": FIRST_SEED + number,
        "factor airframe": airframe,
        "factor sky": sky,
        "frames": visible + 10,
        "visible_frames": visible,
        "hit": hit,
        "hit_initial": hit // 10,
        "wrong": 1,
        "wrong_visible": 1,
        "time_to_track_s": 1.0 + 0.1 * number,
        "due_epochs": 100,
        "covered_epochs": 80,
        "tracking_epochs": 80,
        "misleading_epochs": 2,
        "losses": 1,
        "returned": 1,
        "nees_sum": 240.0,
        "nees_count": 80,
        "nis_sum": 150.0,
        "nis_dof": 300,
        "hit_share": hit / visible if visible else None,
        "wrong_share": 1 / visible if visible else None,
        "coverage": 0.8,
        "anees": 1.0,
        "nis": 0.5,
        "misleading_share": 0.025,
        "near_rmse_y_m": 0.4,
        "excluded_share": 10 / (visible + 10),
        "return_s_max": None,
    }
    for factor in FRAME_FACTORS:
        for kind in factor.classes:
            first = kind == factor.classes[0]
            row[class_column(factor, kind, "visible")] = visible if first else 0
            row[class_column(factor, kind, "hit")] = hit if first else 0
            row[class_column(factor, kind, "wrong")] = 1 if first else 0
    return row


def drawn_rows(seed: int, count: int, share: float) -> list[dict[str, Any]]:
    """Return sessions with binomial hits, and a share that differs between them by 5 points (1 sigma)."""
    generator = np.random.default_rng(seed)
    rows = []
    for number in range(count):
        own = float(np.clip(share + 0.05 * generator.standard_normal(), 0.0, 1.0))
        rows.append(drawn_row(number, visible=200, hit=int(generator.binomial(200, own))))
    return rows
