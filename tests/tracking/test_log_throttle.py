"""A line that is repeated is written once and then counted; another one is written at once; none is lost."""

import re

from hypothesis import given
from hypothesis import strategies as st

from groundstation.tracking.log_throttle import LogThrottle


def jerk(station: str, t_s: float, size: float = 0.1) -> str:
    return f"station {station}: PTU reading at {t_s:.3f} s: a jerk of {size:.3f}°, confirmed by the next reading"


def test_a_flood_is_one_line_and_a_count() -> None:
    reported = list[tuple[float, str]]()
    seldom = LogThrottle(lambda t_s, line: reported.append((t_s, line)))
    for k in range(36):
        seldom.take(0.14 * k, jerk("left", 0.14 * k))
    assert reported == [(0.0, jerk("left", 0.0))]
    seldom.take(1.0, jerk("cam1", 1.0))
    seldom.take(1.0, jerk("cam2", 1.0))
    assert [t_s for t_s, _ in reported] == [0.0, 1.0, 1.0], "another station's is another line"
    seldom.pass_time(5.2)
    assert reported[3][1] == jerk("left", 4.9) + " (35 like it since 0.0 s)"
    seldom.take(5.3, jerk("left", 5.3, 0.4))
    assert len(reported) == 4
    seldom.finish()
    assert reported[4] == (5.3, jerk("left", 5.3, 0.4))
    seldom.take(20.0, jerk("left", 20.0))
    assert reported[5] == (20.0, jerk("left", 20.0)), "after a while it is news again"


@given(gaps_s=st.lists(st.floats(0.0, 8.0), max_size=60), stations=st.lists(st.sampled_from("ab"), min_size=60))
def test_every_line_is_written_or_counted(gaps_s: list[float], stations: list[str]) -> None:
    reported = list[str]()
    seldom, t_s = LogThrottle(lambda _, line: reported.append(line)), 0.0
    for gap_s, station in zip(gaps_s, stations, strict=False):
        t_s += gap_s
        seldom.take(t_s, jerk(station, t_s))
    seldom.finish()
    counts = [re.search(r"\((\d+) like it", line) for line in reported]
    assert sum(1 if c is None else int(c[1]) for c in counts) == len(gaps_s)
