"""What is known of the bytes that came from a camera that OpenCV reads: nothing."""

from types import SimpleNamespace

import numpy as np

from groundstation.sources.cameras.opencv_capture import OpencvCamera


def test_a_frame_states_no_bytes_no_number_and_no_time_of_the_device() -> None:
    camera = OpencvCamera.__new__(OpencvCamera)
    image = np.arange(24, dtype=np.uint8).reshape(2, 4, 3)
    camera._capture = SimpleNamespace(read=lambda: (True, image))
    grab = camera.grab(1.0)
    assert (grab.payload_bytes, grab.frame_id, grab.device_ns) == (0, None, None)
    np.testing.assert_array_equal(grab.pixels, image)
