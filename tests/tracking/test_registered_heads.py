"""Frames whose pictures cannot tell the angles of their heads: the encoder's are used, and the reason is counted."""

import cv2
import numpy as np

from groundstation.arrays import ImageArray
from groundstation.messages import Frame, PtuSample
from groundstation.picture import BgrPicture
from groundstation.registration.head_registration import RegisteredAngles, RegistrationFault
from groundstation.tracking.registered_heads import OPENCV_FAILED, OTHER_SIZE, RegisteredHeads
from groundstation.tracking.synchronise import InterpolatedAngles, ReadyFrame
from tests.stereo_rig import make_rig, standing

FAILS_S = 2.0


class Sky:
    """Tells the angles of each frame but that of `FAILS_S`, in which OpenCV fails; keeps the sizes of what it sees."""

    def __init__(self) -> None:
        self.sizes: list[tuple[int, int]] = []

    def searches(self, sigma_rad: float) -> bool:
        return False

    def register_at(
        self, image: ImageArray, t_s: float, pan_rad: float, tilt_rad: float, sigma_rad: float, rates_rad_s: object
    ) -> RegisteredAngles | RegistrationFault:
        self.sizes.append((image.shape[1], image.shape[0]))
        if t_s == FAILS_S:
            cv2.cvtColor(np.empty((0, 0, 3), np.uint8), cv2.COLOR_BGR2GRAY)
        return RegistrationFault.NO_MATCH


def test_a_picture_of_another_size_and_one_in_which_opencv_fails() -> None:
    sky, read = Sky(), list[PtuSample]()
    heads = RegisteredHeads(make_rig(), {}, stars={"left": sky})
    for t_s, (w, h) in ((1.0, (640, 480)), (FAILS_S, (1280, 960))):
        frame = Frame(t_s=t_s, station="left", epoch=0, image=BgrPicture(np.zeros((h, w, 3), np.uint8)))
        encoder = InterpolatedAngles(pan_rad=0.1, tilt_rad=0.2, variance_share=1.0)
        ready = ReadyFrame(record=frame, angles=encoder, following=None)
        assert heads.with_angles(ready, read.append, standing) is ready
    assert not read
    assert sky.sizes == [(1280, 960)]
    assert heads.notes() == [
        f"head angles of left from the picture in 0 of 2 frames; 1 the encoder's: {OPENCV_FAILED}; "
        f"1 the encoder's: {OTHER_SIZE}"
    ]
