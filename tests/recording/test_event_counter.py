"""The closing record of a recording counts events, epochs and their time span."""

import json

from groundstation.recording.event_counter import EventCounter


def test_events_are_counted_and_epochs_have_a_span() -> None:
    count = EventCounter()
    empty = count.result()
    assert (empty.events, empty.epochs, empty.first_s, empty.last_s) == (0, 0, 0.0, 0.0)
    for values in (
        {"n": 1, "kind": "ptu", "t_s": 0.5},
        {"n": 2, "kind": "epoch", "t_s": 3.0},
        {"n": 3, "kind": "epoch", "t_s": 2.0},
        {"n": 4, "kind": "epoch", "t_s": None},
        {"kind": "pixels"},
    ):
        count.add_line(json.dumps(values).encode())
    end = count.result()
    assert (end.events, end.epochs, end.first_s, end.last_s) == (4, 2, 2.0, 3.0)
