"""The error of a camera whose library is an extra that has not been installed."""

from groundstation.sources.cameras.camera import CameraError


def missing_extra(where: str, library: str, extra: str) -> CameraError:
    """Build (not raise) the error with the command that installs it."""
    return CameraError(f"{where}: got no {library}; wanted it installed: pip install 'groundstation[{extra}]'")
