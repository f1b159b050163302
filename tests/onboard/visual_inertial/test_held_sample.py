"""The last inertial sample holds until a picture that comes after it."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from groundstation.onboard.visual_inertial.nose_navigator import NoseNavigator


@dataclass(frozen=True)
class Sample:
    """An instant, of which nothing else matters here."""

    t_s: float


@dataclass
class Felt:
    """Notes the samples that it takes."""

    times_s: list[float] = field(default_factory=list)

    def process_imu(self, sample: Sample) -> None:
        self.times_s.append(sample.t_s)


@pytest.mark.parametrize(("picture_s", "held"), [(1.25, [1.0, 1.25]), (1.0, [1.0]), (0.5, [1.0])])
def test_the_state_is_brought_to_the_time_of_a_later_picture(
    picture_s: float, held: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    navigator = NoseNavigator.__new__(NoseNavigator)
    navigator._filter, navigator._lasting, navigator._last = Felt(), Felt(), None
    monkeypatch.setattr(NoseNavigator, "_choose_tracker_pose", lambda self, outside: None)
    monkeypatch.setattr(NoseNavigator, "_report", lambda self, t_s, *rest: t_s)
    navigator.process_imu(Sample(t_s=1.0))
    assert navigator.update(picture_s, np.zeros((2, 2, 3), np.uint8), None) == picture_s
    assert navigator._filter.times_s == navigator._lasting.times_s == held
