"""Names for the array types that signatures use."""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
ImageArray = NDArray[np.uint8]
MaskArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]
