"""Pictures without the lens's distortion, and pixels back into the picture as it was."""

import cv2
import numpy as np

from groundstation.arrays import FloatArray, ImageArray
from groundstation.geometry.camera import Lens
from groundstation.onboard.edges.pose import intrinsic_matrix


class Undistorter:
    """Takes the distortion out of pictures of one lens, with the same focal length and principal point."""

    def __init__(self, lens: Lens) -> None:
        self._lens = lens
        self.kappa = intrinsic_matrix(lens)
        self._maps = None
        if np.any(lens.distortion != 0.0):
            size = lens.image_size_px
            self._maps = cv2.initUndistortRectifyMap(
                self.kappa, lens.distortion, np.eye(3), self.kappa, size, cv2.CV_16SC2
            )

    def flat(self, image: ImageArray) -> ImageArray:
        """Return a picture (h, w, 3) in which straight lines are straight."""
        if self._maps is None:
            return image
        return np.asarray(cv2.remap(image, *self._maps, cv2.INTER_LINEAR))

    def original(self, pixels: FloatArray) -> FloatArray:
        """Return pixels (n, 2) of the flat picture as pixels of the original one."""
        if self._maps is None:
            return pixels
        rays = np.column_stack([pixels, np.ones(len(pixels))]) @ np.linalg.inv(self.kappa).T
        seen, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), self.kappa, self._lens.distortion)
        return np.asarray(seen.reshape(-1, 2))
