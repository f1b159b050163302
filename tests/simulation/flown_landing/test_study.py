"""The study of landings on the stream: what did not touch down is in no mean, and is counted."""

from typing import Any

import closed_loop_landing
import numpy as np

from groundstation.simulation.flown_landing.landing_flight import LandingOutcome


def landing(along_m: float, across_m: float, outcome: LandingOutcome = LandingOutcome.TOUCHDOWN) -> dict[str, Any]:
    return {"outcome": outcome.value, "t_s": 25.0, "touchdown_m": [along_m, across_m], "sink_m_s": 0.5}


def flight(true: dict[str, Any], stream: dict[str, Any], up_m: float = 0.1) -> dict[str, Any]:
    squares = [100 * 0.2**2, 100 * 1.0**2, 100 * up_m**2]
    return {
        "true": true,
        "stream": stream,
        "station": squares,
        "estimates": 100,
        "vehicle": squares,
        "steps": 100,
        "samples": 200,
        "late": 1,
        "gap_s": 0.7,
    }


def test_the_summary_counts_what_did_not_touch_down_apart() -> None:
    generator = np.random.default_rng(3)
    places = generator.normal(size=(30, 2)) * [10.0, 1.0]
    flights = [flight(landing(a, c), landing(1.5 * a + 2.0, c)) for a, c in places]
    flights.append(flight(landing(0.0, 0.0), landing(5000.0, 900.0, LandingOutcome.GO_AROUND), up_m=1.0))
    text = closed_loop_landing.summary(flights)
    assert "true: 31 touchdown, 0 go-around" in text
    assert "stream: 30 touchdown, 1 go-around" in text
    assert "of 30 that touched down on both" in text
    assert "ratio 1.50 (95 %: 1.50 … 1.50)" in text
    assert "ratio 1.00" in text
    rms = np.sqrt((30 * 0.1**2 + 1.0) / 31)
    assert f"rms error up {rms:.3f} m (worst landing 1.000), across 0.200, along 1.000" in text
    assert "positions taken 6200, too late for the filter 31" in text


def test_a_study_of_go_arounds_alone_has_no_scatter() -> None:
    around = landing(0.0, 0.0, LandingOutcome.GO_AROUND)
    text = closed_loop_landing.summary([flight(landing(0.0, 0.0), around)])
    assert "along: too few" in text
    assert "stream: 0 touchdown, 1 go-around" in text
