"""Settings as GenICam cameras know them: written by name, older names too, and read back.

Names are those of GenICam's Standard Features Naming Convention, with those of GigE cameras before it.
"""

from typing import Protocol

from groundstation.sources.cameras.camera import CameraError, CameraSettings, SettingsReadBack

_EXPOSURE = ("ExposureTime", "ExposureTimeAbs", "ExposureTimeRaw")
_GAIN = ("Gain", "GainAbs", "GainRaw")
_RATE = ("AcquisitionFrameRate", "AcquisitionFrameRateAbs")
_SERIAL = ("DeviceSerialNumber", "DeviceID")
_ROI = ("OffsetX", "OffsetY", "Width", "Height")
# cameras keep exposures and gains in steps of their own
_STEP = 0.02


class GenicamFeatures(Protocol):
    """A camera's features by name; None where it has none of that name, or it cannot be read now."""

    def number(self, name: str) -> float | None:
        """Return the value of a number."""

    def text(self, name: str) -> str | None:
        """Return the value of a text or of a choice."""

    def write(self, name: str, value: float | str | bool) -> None:
        """Write a value; raises `CameraError` where the camera refuses it."""


def apply_settings(features: GenicamFeatures, settings: CameraSettings, where: str) -> SettingsReadBack:
    """Write settings to a camera at rest and return the values read back.

    Raises `CameraError` for a setting that the camera does not have, refuses, or sets to another value.
    """
    if settings.pixel_format is not None:
        _write(features, "PixelFormat", settings.pixel_format, f"{where}: pixel format")
    if settings.roi_px is not None:
        _write_roi(features, settings.roi_px, where)
    if settings.exposure_s is not None:
        _automatic_off(features, "ExposureAuto")
        _write_number(features, _EXPOSURE, settings.exposure_s * 1e6, f"{where}: exposure in µs")
    if settings.gain is not None:
        _automatic_off(features, "GainAuto")
        _write_number(features, _GAIN, settings.gain, f"{where}: gain")
    if settings.rate_hz is not None:
        if features.text("AcquisitionFrameRateEnable") is not None:
            _write(features, "AcquisitionFrameRateEnable", True, f"{where}: rate")
        _write_number(features, _RATE, settings.rate_hz, f"{where}: rate in Hz")
    if settings.trigger is not None:
        _write_trigger(features, settings.trigger, where)
    found = read_back(features)
    if settings.roi_px is not None and found.roi_px != settings.roi_px:
        raise CameraError(f"{where}: region x, y, w, h: got {found.roi_px}; wanted {settings.roi_px}")
    return found


def read_back(features: GenicamFeatures) -> SettingsReadBack:
    """Return the settings that the camera reports."""
    exposure_us = _first_number(features, _EXPOSURE)
    size = (features.number("Width"), features.number("Height"))
    corner = (features.number("OffsetX"), features.number("OffsetY"))
    mode = features.text("TriggerMode")
    names = (features.text("DeviceVendorName"), features.text("DeviceModelName"))
    size_px = None if size[0] is None or size[1] is None else (int(size[0]), int(size[1]))
    return SettingsReadBack(
        model=" ".join(n for n in names if n) or "a GenICam camera",
        serial=next((t for n in _SERIAL if (t := features.text(n))), None),
        size_px=size_px,
        exposure_s=None if exposure_us is None else exposure_us * 1e-6,
        gain=_first_number(features, _GAIN),
        roi_px=None if size_px is None else (int(corner[0] or 0), int(corner[1] or 0), *size_px),
        trigger=None if mode is None else "off" if mode == "Off" else (features.text("TriggerSource") or mode),
        pixel_format=features.text("PixelFormat"),
        rate_hz=_first_number(features, _RATE),
    )


def _automatic_off(features: GenicamFeatures, name: str) -> None:
    """Switch an automatic off where there is one that is on."""
    if features.text(name) not in (None, "Off"):
        features.write(name, "Off")


def _write_trigger(features: GenicamFeatures, trigger: str, where: str) -> None:
    if features.text("TriggerMode") is None:
        if trigger == "off":
            return
        raise CameraError(f"{where}: trigger: got a camera without TriggerMode; wanted {trigger!r}")
    if features.text("TriggerSelector") is not None:
        _write(features, "TriggerSelector", "FrameStart", f"{where}: trigger")
    if trigger != "off":
        _write(features, "TriggerSource", trigger, f"{where}: trigger")
    _write(features, "TriggerMode", "Off" if trigger == "off" else "On", f"{where}: trigger")


def _write_roi(features: GenicamFeatures, roi_px: tuple[int, int, int, int], where: str) -> None:
    """Write a region: to the corner first, so that any size fits, then the size, then the place."""
    x, y, w, h = roi_px
    for name, value in (("OffsetX", 0), ("OffsetY", 0), ("Width", w), ("Height", h), ("OffsetX", x), ("OffsetY", y)):
        if features.number(name) is None and value == 0:
            continue
        _write(features, name, value, f"{where}: region")


def _write(features: GenicamFeatures, name: str, value: float | str | bool, where: str) -> None:
    """Write one feature and compare it with the value read back."""
    is_text = isinstance(value, str)
    if (features.text(name) if is_text or isinstance(value, bool) else features.number(name)) is None:
        raise CameraError(f"{where}: got a camera without {name}; wanted {value}")
    try:
        features.write(name, value)
    except CameraError as error:
        raise CameraError(f"{where}: got a refusal of {name} ({error}); wanted {value}") from error
    got = features.text(name) if is_text else None
    if is_text and got != value:
        raise CameraError(f"{where}: got {name} {got}; wanted {value}")


def _write_number(features: GenicamFeatures, names: tuple[str, ...], value: float, where: str) -> None:
    """Write the first feature of these names that the camera has; it may round to its own steps."""
    name = next((n for n in names if features.number(n) is not None), None)
    if name is None:
        raise CameraError(f"{where}: got a camera without {', '.join(names)}; wanted {value:g}")
    _write(features, name, value, where)
    got = features.number(name)
    if got is None or abs(got - value) > max(_STEP * abs(value), 1.0 if name.endswith("Raw") else 0.0):
        raise CameraError(f"{where}: got {name} {got}; wanted {value:g}")


def _first_number(features: GenicamFeatures, names: tuple[str, ...]) -> float | None:
    return next((v for n in names if (v := features.number(n)) is not None), None)
