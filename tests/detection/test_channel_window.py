"""The window of the learned channel: pixels are where its mapping has them, at every size and at the border."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.detection.channel_window import TARGET_PX, WINDOW_PX, ChannelWindow, channel_window
from groundstation.picture import as_picture


@given(
    scale=st.floats(0.05, 8.0),
    origin=st.tuples(st.floats(-2000.0, 2000.0), st.floats(-2000.0, 2000.0)),
    point=st.tuples(st.floats(-500.0, 500.0), st.floats(-500.0, 500.0)),
)
def test_the_mapping_goes_both_ways(scale: float, origin: tuple[float, float], point: tuple[float, float]) -> None:
    window = ChannelWindow(
        image=np.zeros((WINDOW_PX[1], WINDOW_PX[0], 3), np.uint8), scale=scale, origin_px=np.array(origin)
    )
    there = window.to_picture(np.array([point]))
    np.testing.assert_allclose(window.from_picture(there), [point], atol=1e-6)


@pytest.mark.parametrize("span_px", [10.0, 31.0, 44.0, 60.0, 97.0, 150.0, 200.0, 400.0])
@pytest.mark.parametrize("off_px", [(0.0, 0.0), (0.3, -0.4)])
def test_a_spot_is_seen_where_it_is(span_px: float, off_px: tuple[float, float]) -> None:
    """A blurred spot of a tenth of the span: its centre of light in the window is mapped back onto it."""
    rows, columns = np.mgrid[0:900, 0:1200]
    place = np.array([600.0 + 0.3 * span_px, 450.0 - 0.25 * span_px]) + off_px
    spread = max(0.1 * span_px, 1.5)
    spot = np.exp(-0.5 * ((columns - place[0]) ** 2 + (rows - place[1]) ** 2) / spread**2)
    picture = as_picture(np.repeat((200.0 * spot).round().astype(np.uint8)[:, :, None], 3, axis=2))
    window = channel_window(picture, np.array([600.0, 450.0]), span_px)
    assert window is not None
    assert window.scale == pytest.approx(TARGET_PX / span_px)
    light = window.image[:, :, 0].astype(np.float64)
    v, u = np.mgrid[0 : light.shape[0], 0 : light.shape[1]]
    centre = np.array([(light * u).sum(), (light * v).sum()]) / light.sum()
    np.testing.assert_allclose(window.to_picture(centre), place, atol=max(0.1, 0.0025 * span_px))


def test_outside_the_picture_its_border_is_repeated_and_farther_there_is_nothing() -> None:
    image = np.zeros((100, 100, 3), np.uint8)
    image[:, 0] = 250
    window = channel_window(as_picture(image), np.array([0.0, 50.0]), TARGET_PX)
    assert window is not None
    assert np.all(window.image[:, :60] >= 240)
    assert np.all(window.image[:, 70:] == 0)
    assert channel_window(as_picture(image), np.array([400.0, 50.0]), TARGET_PX) is None
