"""Why a run has no track, from its counts."""

from typing import Any

import pytest

from groundstation.evaluation.missing_track import why_no_track


def counts(*, stations: dict[str, tuple[int, int]] | None = None, **track: int) -> dict[str, Any]:
    """Counts of a summary; ``stations`` by name have pictures, and pictures without an angle among them."""
    stations = {"left": (40, 0), "right": (40, 0)} if stations is None else stations
    return {
        "track": {"searching": 0, "acquiring": 0, "tracking": 0, "coasting": 0, "lost": 0, **track},
        "detection": {
            name: {"status": {"miss": looks}, "miss_reason": {"no_ptu_angle": blind}}
            for name, (looks, blind) in stations.items()
        },
    }


@pytest.mark.parametrize(
    ("found", "words"),
    [
        (counts(), "no pair of pictures was processed"),
        (counts(searching=40), "in none of 40 pairs did two cameras show a moving target"),
        (counts(searching=30, acquiring=10), "of 40 pairs, 10 had a candidate in two cameras"),
        (
            counts(searching=40, stations={"left": (14, 0), "right": (13, 0), "third": (13, 0)}),
            "each of 40 pairs has a picture or a pixel of one camera alone",
        ),
        (counts(coasting=3, lost=37), "in 40 pairs a target was found and lost again"),
        (counts(searching=40, stations={"left": (40, 0)}), "only left delivered pictures or pixels"),
        (counts(searching=40, stations={}), "no station delivered"),
        (
            counts(searching=40, stations={"left": (40, 0), "right": (40, 36)}),
            "36 of 40 pictures of right had no angle",
        ),
    ],
)
def test_the_reason_is_that_of_the_counts(found: dict[str, Any], words: str) -> None:
    reason = why_no_track(found)
    assert reason is not None
    assert reason.startswith("no track: ")
    assert words in reason


def test_a_run_that_tracked_has_no_reason() -> None:
    assert why_no_track(counts(tracking=1, searching=39)) is None


@pytest.mark.parametrize("found", [counts(searching=40), counts(acquiring=5, searching=35)])
def test_a_run_that_saw_no_moving_target_names_the_inputs_that_may_be_why(found: dict[str, Any]) -> None:
    """A tenth of the focal length leaves nothing that moves as an aircraft, and a real session has no truth."""
    reason = why_no_track(found)
    assert reason is not None
    assert reason.endswith("if an aircraft was there, are focal lengths, angles, clocks and places right?")
