"""Parameters of a camera: lens, sensor, exposure, coding, and late or lost frames."""

from dataclasses import dataclass

import numpy as np

from groundstation.geometry.camera import Lens
from groundstation.picture import BayerPattern
from groundstation.simulation.optics import ExposureStep, Optics
from groundstation.simulation.parameter_checks import require, require_finite, require_positive
from groundstation.simulation.picture_writer import PictureCoding, PictureFormat
from groundstation.simulation.rendered_session_folder import CameraRecording

_LEAST_SIDE_PX, _MOST_SIDE_PX = 16, 8192
_MAX_READOUT_S, MAX_PHASE_S = 0.1, 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraSpec:
    """One camera, as it truly is.

    Attributes
    ----------
    image_size_px : width and height.
    focal_px : of the lens, in pixels of this sensor.
    principal_offset_px : of the optical axis from the picture's centre, right and down.
    distortion : OpenCV's k1 k2 p1 p2 k3.
    colour : a sensor with colours in this ``pattern``, or a grey one.
    exposure_s : how long light is gathered; motion within it blurs.
    gain : grey levels are light × exposure / 3 ms × gain.
    electrons_per_level, read_noise_electrons : of one grey level at gain 1; one sigma of every pixel.
    blur_px, defocus_px : one sigma of the lens's blur, and of a blur by wrong focus.
    vignetting : share of light that a corner loses.
    flicker, flicker_hz : amplitude, as a share of the brightness, and frequency of its variation.
    exposure_steps : of the automatic exposure.
    readout_s : rolling shutter, first row to last; 0 is a global one.
    phase_s : exposures are so much later than the pair's nominal time.
    lost_share : share of frames that never arrive.
    coding, quality : format of the pictures, and JPEG's quality (1 to 100) or H.264's CRF (0 to 51).
    """

    image_size_px: tuple[int, int] = (1280, 960)
    focal_px: float = 6680.0
    principal_offset_px: tuple[float, float] = (0.0, 0.0)
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    colour: bool = True
    pattern: BayerPattern = BayerPattern.RG
    exposure_s: float = 0.003
    gain: float = 1.0
    electrons_per_level: float = 40.0
    read_noise_electrons: float = 12.0
    blur_px: float = 0.6
    defocus_px: float = 0.0
    vignetting: float = 0.0
    flicker: float = 0.0
    flicker_hz: float = 1.0
    exposure_steps: tuple[ExposureStep, ...] = ()
    readout_s: float = 0.0
    phase_s: float = 0.0
    lost_share: float = 0.0
    coding: PictureFormat = PictureFormat.JPEG
    quality: int | None = None

    def __post_init__(self) -> None:
        sides = all(_LEAST_SIDE_PX <= n <= _MOST_SIDE_PX for n in self.image_size_px)
        wanted = f"sides of {_LEAST_SIDE_PX} to {_MOST_SIDE_PX} px"
        require(sides, "CameraSpec: image_size_px", got=self.image_size_px, wanted=wanted)
        even = self.coding is not PictureFormat.H264 or all(n % 2 == 0 for n in self.image_size_px)
        require(even, "CameraSpec: image_size_px", got=self.image_size_px, wanted="even sides for h264")
        require_positive("CameraSpec: focal_px", self.focal_px)
        for value in (*self.principal_offset_px, *self.distortion):
            require_finite("CameraSpec: principal_offset_px, distortion", value)
        slow = abs(self.readout_s) <= _MAX_READOUT_S
        require(slow, "CameraSpec: readout_s", got=self.readout_s, wanted=f"at most {_MAX_READOUT_S:g} s")
        late = abs(self.phase_s) <= MAX_PHASE_S
        require(late, "CameraSpec: phase_s", got=self.phase_s, wanted=f"at most {MAX_PHASE_S:g} s")
        # these check the rest
        self.optics()
        self.recording()

    def optics(self) -> Optics:
        """Return exposure and sensor."""
        return Optics(
            pattern=self.pattern if self.colour else None,
            exposure_s=self.exposure_s,
            gain=self.gain,
            electrons_per_level=self.electrons_per_level,
            read_noise_electrons=self.read_noise_electrons,
            blur_px=self.blur_px,
            defocus_px=self.defocus_px,
            vignetting=self.vignetting,
            flicker=self.flicker,
            flicker_hz=self.flicker_hz,
            exposure_steps=self.exposure_steps,
        )

    def lens(self) -> Lens:
        """Return the true lens."""
        w, h = self.image_size_px
        return Lens(
            image_size_px=(w, h),
            focal_px=np.array([self.focal_px, self.focal_px]),
            principal_point_px=0.5 * (np.array([w, h]) - 1.0) + np.array(self.principal_offset_px),
            distortion=np.array(self.distortion),
        )

    def recording(self) -> CameraRecording:
        """Return how its pictures are kept."""
        coding = PictureCoding(form=self.coding, quality=self.quality)
        return CameraRecording(coding=coding, lost_share=self.lost_share)
