"""How many events are kept, and from how many epochs on a share is stated."""

import pytest

from groundstation.evaluation.accuracy_table import FEW_EPOCHS
from groundstation.evaluation.collector import MAX_EVENTS, ResultCollector
from groundstation.evaluation.report_tables import _accuracy_row
from groundstation.messages import StepReport, TrackEvent


def test_events_beyond_the_most_are_counted_and_not_kept() -> None:
    collector = ResultCollector()
    events = [TrackEvent(t_s=float(k), level="info", text="again") for k in range(MAX_EVENTS + 3)]
    collector.write(StepReport(events=tuple(events)))
    assert (len(collector.events), collector.events_dropped) == (MAX_EVENTS, 3)


@pytest.mark.parametrize(("epochs", "shown"), [(FEW_EPOCHS - 1, False), (FEW_EPOCHS, True)])
def test_an_improvement_is_stated_from_the_fewest_epochs_on(epochs: int, shown: bool) -> None:
    common = {"epochs": epochs, "improvement_percent": [71.0, 72.0, 73.0]}
    common |= {"ekf_rmse_m": [0.1, 0.2, 0.3], "triangulation_rmse_m": [0.1, 0.2, 0.3]}
    group = {
        "common": common,
        "anees": 1.0,
        "bound": {"track_sigma_m": [0.1] * 3, "ekf_over_track": [1.0] * 3, "triangulation_over_fix": [1.0] * 3},
    }
    for way in ("ekf", "triangulation"):
        group[way] = {"epochs": epochs, "coverage": 1.0}
    _, cells = _accuracy_row("all", group)
    assert ("+72" in "".join(cells)) == shown
