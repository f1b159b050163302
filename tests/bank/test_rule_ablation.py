"""Rules that a run can go without: each names something that is there, and is out inside its block only."""

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import rule_ablation
from rules.all_rules import RULES
from rules.rule import Rule

from groundstation.bank.score_world import WorldJob

ROWS = (
    {"visible_frames": 100, "hit": 90, "wrong_visible": 2},
    {"visible_frames": 50, "hit": 50, "wrong_visible": 0},
)


def row(**figures: Any) -> dict[str, Any]:
    others = {"tracking_epochs": 80, "misleading_epochs": 1, "nees_sum": 120.0, "nees_count": 80, "cpu_s": 4.0}
    return {**others, "time_to_track_s": 1.0, **figures}


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.name)
def test_a_rule_is_out_inside_its_block_only(rule: Rule) -> None:
    before = vars(rule.where)[rule.attribute]
    with rule.left_out():
        without = vars(rule.where)[rule.attribute]
        assert without is not before
        assert without != before
    assert vars(rule.where)[rule.attribute] is before


@pytest.mark.parametrize("rule", [r for r in RULES if callable(vars(r.where)[r.attribute])], ids=lambda rule: rule.name)
def test_a_stand_in_takes_the_same_arguments(rule: Rule) -> None:
    """Expected: a call of the rule's function is a call of what stands in its place."""
    before: Callable[..., Any] = vars(rule.where)[rule.attribute]
    stand_in = inspect.signature(rule.without(before))
    positional, named = [], {}
    for name, parameter in inspect.signature(before).parameters.items():
        if parameter.kind is parameter.KEYWORD_ONLY:
            named[name] = None
        else:
            positional.append(None)
    stand_in.bind(*positional, **named)


def test_names_are_different() -> None:
    assert len({rule.name for rule in RULES}) == len(RULES)


def test_a_world_is_scored_without_the_rule_that_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    rule = RULES[0]
    before = vars(rule.where)[rule.attribute]
    seen = []

    def scored(job: WorldJob) -> dict[str, Any]:
        seen.append(vars(rule.where)[rule.attribute] is before)
        return {"row": {"seed": job.seed, "keep": job.worlds}}

    rendered = []
    monkeypatch.setattr(rule_ablation, "score_world", scored)
    monkeypatch.setattr(rule_ablation, "rendered_world", lambda world, folder: rendered.append((world.seed, folder)))
    for name in (rule_ablation.AS_IT_IS, rule.name):
        found = rule_ablation.scored_without({"seed": 7, "rule": name, "keep": "worlds"})
        assert (found["seed"], found["keep"]) == (7, "worlds")
    assert seen == [True, False]
    # what is rendered is not the rule's time
    assert rendered == [(7, Path("worlds"))] * 2
    with pytest.raises(KeyError, match="no rule of this name"):
        rule_ablation.scored_without({"seed": 7, "rule": "no rule of this name", "keep": "worlds"})


def test_a_line_shows_what_changes() -> None:
    before = [row(**each) for each in ROWS]
    after = [row(**{**each, "hit": each["hit"] - 6, "cpu_s": 3.0}) for each in ROWS]
    assert rule_ablation.line("as it is", before, before).split(" | ")[1:3] == ["93.33 %", "1.33 %"]
    cells = rule_ablation.line("one", before, after).split(" | ")
    # of 150 frames 12 fewer: 8 points; both worlds lose 6, a share between 6 and 12 of each
    assert cells[1].startswith("-8.00 (-12.00 … -6.00")
    assert cells[2].startswith("+0.00")
    assert cells[3:] == ["2 of 160", "0.50", "1.00 (2)", "0.75 |"]
