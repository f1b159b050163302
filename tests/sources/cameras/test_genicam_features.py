"""Settings by GenICam's names, new and old: written in order, read back, refused in one line."""

import pytest

from groundstation.sources.cameras.camera import CameraError, CameraSettings
from groundstation.sources.cameras.genicam_features import apply_settings

Value = float | str


class Camera:
    """Features in a dictionary, that log what is written; ``most`` and ``step`` limit a number as cameras do."""

    def __init__(self, values: dict[str, Value], most: dict[str, float] | None = None, step: float = 0.0) -> None:
        self.values = values
        self.most = most or {}
        self.step = step
        self.written: list[tuple[str, Value]] = []

    def number(self, name: str) -> float | None:
        value = self.values.get(name)
        return None if value is None or isinstance(value, str) else float(value)

    def text(self, name: str) -> str | None:
        value = self.values.get(name)
        return None if value is None else str(value)

    def write(self, name: str, value: float | str | bool) -> None:
        if not isinstance(value, str) and value > self.most.get(name, 1e12):
            raise CameraError(f"{value:g} is above {self.most[name]:g}")
        if isinstance(value, float) and self.step:
            value = round(value / self.step) * self.step
        self.written.append((name, value))
        self.values[name] = value


def modern() -> dict[str, Value]:
    return {
        "DeviceVendorName": "Maker",
        "DeviceModelName": "One",
        "DeviceSerialNumber": "42",
        "Width": 1280,
        "Height": 960,
        "OffsetX": 0,
        "OffsetY": 0,
        "PixelFormat": "Mono8",
        "ExposureTime": 10000.0,
        "ExposureAuto": "Continuous",
        "Gain": 0.0,
        "GainAuto": "Off",
        "AcquisitionFrameRateEnable": "False",
        "AcquisitionFrameRate": 25.0,
        "TriggerSelector": "AcquisitionStart",
        "TriggerMode": "Off",
        "TriggerSource": "Line0",
    }


def test_all_is_written_and_read_back() -> None:
    camera = Camera(modern())
    settings = CameraSettings(
        exposure_s=0.004, gain=6.0, roi_px=(16, 8, 640, 480), trigger="Line1", pixel_format="BayerRG8", rate_hz=30.0
    )
    found = apply_settings(camera, settings, "left")
    assert (found.model, found.serial, found.size_px) == ("Maker One", "42", (640, 480))
    assert found.exposure_s == pytest.approx(0.004)
    assert (found.gain, found.roi_px, found.trigger) == (6.0, (16, 8, 640, 480), "Line1")
    assert (found.pixel_format, found.rate_hz) == ("BayerRG8", 30.0)
    names = [name for name, _ in camera.written]
    # automatics before what they would change, the corner before the size, the trigger last
    assert names.index("ExposureAuto") < names.index("ExposureTime")
    assert names.index("OffsetX") < names.index("Width") < len(names) - 1 - names[::-1].index("OffsetX")
    assert "GainAuto" not in names
    assert camera.values["TriggerSelector"] == "FrameStart"
    assert names[-1] == "TriggerMode"


def test_what_is_not_given_is_not_touched() -> None:
    camera = Camera(modern())
    assert apply_settings(camera, CameraSettings(), "left").trigger == "off"
    assert not camera.written


def test_names_of_older_cameras() -> None:
    camera = Camera({"Width": 640, "Height": 480, "ExposureTimeAbs": 100, "GainRaw": 1, "AcquisitionFrameRateAbs": 5.0})
    found = apply_settings(camera, CameraSettings(exposure_s=0.002, gain=7.0, rate_hz=20.0, trigger="off"), "left")
    assert found.exposure_s == pytest.approx(0.002)
    assert (found.gain, found.rate_hz, found.trigger, found.roi_px) == (7.0, 20.0, None, (0, 0, 640, 480))


def test_a_cameras_own_steps_are_kept() -> None:
    found = apply_settings(Camera(modern(), step=27.0), CameraSettings(exposure_s=0.004), "left")
    assert found.exposure_s == pytest.approx(0.003996)


@pytest.mark.parametrize(
    ("settings", "complaint"),
    [
        (
            CameraSettings(exposure_s=1.0),
            r"left: exposure in µs: got a refusal of ExposureTime .*; wanted 1e\+06|1000000",
        ),
        (CameraSettings(roi_px=(0, 0, 4000, 10)), r"left: region: got a refusal of Width .*; wanted 4000"),
    ],
)
def test_a_refusal_is_one_line(settings: CameraSettings, complaint: str) -> None:
    with pytest.raises(CameraError, match=complaint) as error:
        apply_settings(Camera(modern(), most={"ExposureTime": 5e5, "Width": 1280}), settings, "left")
    assert "\n" not in str(error.value)


def test_what_a_camera_lacks_or_does_not_keep_is_an_error() -> None:
    bare: dict[str, Value] = {"Width": 640, "Height": 480}
    for settings, wanted in (
        (CameraSettings(exposure_s=0.01), "got a camera without ExposureTime"),
        (CameraSettings(gain=1.0), "got a camera without Gain"),
        (CameraSettings(trigger="Line1"), "got a camera without TriggerMode"),
        (CameraSettings(pixel_format="Mono8"), "got a camera without PixelFormat"),
        (CameraSettings(roi_px=(8, 0, 64, 64)), "got a camera without OffsetX"),
    ):
        with pytest.raises(CameraError, match=wanted):
            apply_settings(Camera(dict(bare)), settings, "left")
    with pytest.raises(CameraError, match=r"exposure in µs: got ExposureTime 5000.*; wanted 4000"):
        apply_settings(Camera(modern(), step=5000.0), CameraSettings(exposure_s=0.004), "left")
