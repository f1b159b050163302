"""A short part of `benchmarks/ptu_serial_faults.py` and `ptu_alpaca_faults.py`: each fault alone, and all together."""

import ptu_alpaca_faults
import pytest
from ptu_serial_faults import FAULTS, MAKERS, RECOVERY_S, FaultCampaignCounts, campaign, fuzz, one_run

from tests.peers import peer_module


@pytest.mark.parametrize("name", [*MAKERS, "alpaca"])
def test_no_wrong_angle_and_back_in_time(name: str) -> None:
    if name == "dynamixel":
        peer_module("dynamixel-sdk", "dynamixel_sdk")
    tally = ptu_alpaca_faults.campaign(6, 5000) if name == "alpaca" else campaign(name, 6, first_seed=5000)
    assert tally.angles > 500
    assert sum(tally.failures.values()) > 20
    assert (tally.wrong, tally.not_back, tally.slow, tally.still_moving, tally.too_long) == (0, 0, 0, 0, 0)
    assert max(tally.recovery_s) < RECOVERY_S


@pytest.mark.parametrize("fault", FAULTS)
def test_each_fault_alone(fault: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for other in tuple(FAULTS):
        if other != fault:
            monkeypatch.delitem(FAULTS, other)
    tally = FaultCampaignCounts()
    one_run(MAKERS["pelco"], 77, tally)
    assert tally.faults[fault] == 6
    assert (tally.wrong, tally.not_back, tally.slow, tally.still_moving) == (0, 0, 0, 0)
    assert tally.angles > 10


def test_random_strings() -> None:
    assert sum(fuzz(20_000).values()) > 10
