"""Reading a planned site from its TOML file (docs/formats.md)."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from groundstation.errors import RigError, SiteError
from groundstation.files.text_file import absence
from groundstation.files.toml_table import TomlTable, load_toml, quoted, shown
from groundstation.geometry.camera import Lens
from groundstation.planning.site import Aircraft, Requirement, Site
from groundstation.rig.covariance import ParameterCovariance
from groundstation.rig.rig import MAX_STATIONS, ClockModel, Rig, Station, load_rig

SITE_FORMAT = "groundstation-site/1"
MAX_FRAMES = 20_000
MAX_RANGES = 200
# ten degrees, metres or seconds: beyond it, small errors are no longer what is computed with
_MOST_SIGMA = 10.0
_FAR_M = 20_000.0
# chosen: finer than any sensor's pixel and coarser than a thermal one's; a lens on a chip, and a telescope
_PIXEL_UM, _FOCAL_MM = (0.3, 200.0), (0.5, 10_000.0)
_TOP = {"format", "name", "rig", "baseline_m", "height_m", "station"}
_TABLES = {"camera", "ptu", "calibration", "aircraft", "range", "required_sigma_m"}
_LENS = {"focal_mm", "pixel_um", "focal_px", "image_size_px"}
# the site's words for a calibration's sigmas: parameters of the rig, and the unit's factor
_QUALITY = {
    "mount_pan_deg": (("runway_from_base.z",), math.radians(1.0)),
    "mount_tilt_deg": (("runway_from_base.x",), math.radians(1.0)),
    "mount_roll_deg": (("runway_from_base.y",), math.radians(1.0)),
    "boresight_deg": (("head_from_camera.x", "head_from_camera.z"), math.radians(1.0)),
    "position_m": (tuple(f"ptu_position.{axis}" for axis in "xyz"), 1.0),
    "lever_arm_m": (tuple(f"camera_in_head.{axis}" for axis in "xyz"), 1.0),
}
_CLOCKS = {"camera_camera_s", "camera_ptu_s"}


def load_site(path: Path) -> Site:
    """Read a site file; raises `SiteError` or `RigError` with file, table and key of the first fault."""
    top = TomlTable(load_toml(path, SiteError), str(path), SiteError)
    if top.text("format", SITE_FORMAT) != SITE_FORMAT:
        raise top.fail("format", quoted(top.values["format"]), repr(SITE_FORMAT))
    top.refuse_unknown(_TOP | _TABLES)
    ways = [key for key in ("rig", "baseline_m", "station") if key in top]
    if len(ways) != 1:
        raise SiteError(
            str(path), got=" and ".join(ways) or "no stations", wanted="one of rig, baseline_m, [[station]]"
        )
    camera = top.table("camera")
    own_rig = "rig" in top
    camera.refuse_unknown({"frame_rate_hz", "pixel_sigma_px", "min_silhouette_px"} | _LENS)
    for key in _LENS & camera.values.keys() if own_rig else ():
        raise camera.fail(key, "it together with rig", "one of them: the rig has its own lenses")
    rig = _given_rig(top, path) if own_rig else _planned_rig(top, camera)
    calibration = top.table("calibration")
    calibration.refuse_unknown(_QUALITY.keys() | _CLOCKS)
    if calibration.values or not own_rig:
        rig = _with_quality(rig, calibration)
    ranges = top.table("range")
    ranges.refuse_unknown({"from_m", "to_m", "step_m"})
    from_m = ranges.number("from_m", 60.0, minimum=1.0)
    to_m = ranges.number("to_m", 600.0, above=from_m, maximum=_FAR_M)
    step_m = ranges.number("step_m", (to_m - from_m) / 9.0, above=0.0)
    if (to_m - from_m) / step_m > MAX_RANGES:
        raise ranges.fail("step_m", f"{step_m:g}", f"at least {(to_m - from_m) / MAX_RANGES:g}: {MAX_RANGES} ranges")
    aircraft = _aircraft(top.table("aircraft"))
    rate_hz = camera.number("frame_rate_hz", 30.0, above=0.0)
    frames = rate_hz * (to_m - from_m) / aircraft.speed_m_s
    if frames > MAX_FRAMES:
        raise camera.fail("frame_rate_hz", f"{rate_hz:g}, {frames:.0f} frames in all", f"at most {MAX_FRAMES} frames")
    return Site(
        name=shown(top.text("name", path.stem), 200),
        rig=rig,
        station_clock_sigma_s=calibration.number("camera_camera_s", 0.0, minimum=0.0, maximum=_MOST_SIGMA)
        / math.sqrt(2.0),
        pixel_sigma_px=camera.number("pixel_sigma_px", 1.0, minimum=0.001, maximum=1000.0),
        min_silhouette_px=camera.number("min_silhouette_px", 10.0, minimum=0.0),
        frame_rate_hz=rate_hz,
        aircraft=aircraft,
        from_m=from_m,
        to_m=to_m,
        step_m=step_m,
        required=_required(top.table("required_sigma_m")),
    )


def _given_rig(top: TomlTable, path: Path) -> Rig:
    """Load the rig that the site names, relative to the site's file."""
    for key in ("ptu", "height_m"):
        if key in top:
            raise top.fail(key, "it together with rig", "one of them: the rig has its own")
    named = path.parent / top.text("rig")
    if not named.is_file():
        raise RigError(f"{path}: rig: {named}", got=absence(named), wanted="a rig file")
    rig = load_rig(named)
    rig.require_known()
    return rig


def _planned_rig(top: TomlTable, camera: TomlTable) -> Rig:
    """Build the rig of stations that look along the runway, all alike but for their places."""
    lens = _lens(camera)
    ptu = top.table("ptu")
    ptu.refuse_unknown({"resolution_deg", "sigma_deg"})
    resolution_deg = ptu.number("resolution_deg", minimum=0.0, maximum=_MOST_SIGMA)
    sigma_deg = ptu.number("sigma_deg", resolution_deg / math.sqrt(12.0), minimum=0.0, maximum=_MOST_SIGMA)
    stations = [
        Station(
            name=name,
            fixed=False,
            known=("position", "orientation", "lens"),
            ptu_position_m=np.array(place),
            runway_from_base_wxyz=np.array([1.0, 0.0, 0.0, 0.0]),
            head_from_camera_wxyz=np.array([0.5**0.5, -(0.5**0.5), 0.0, 0.0]),
            camera_in_head_m=np.zeros(3),
            lens=lens,
            ptu_resolution_rad=math.radians(resolution_deg),
            ptu_sigma_rad=math.radians(sigma_deg),
            ptu_clock=ClockModel(),
            camera_clock=None,
            readout_s=0.0,
            covariance_parameters=(),
            covariance=np.zeros((0, 0)),
        )
        for name, place in _places(top).items()
    ]
    return Rig(stations=tuple(stations), path=top.where)


def _places(top: TomlTable) -> dict[str, tuple[float, float, float]]:
    """Return where the stations stand, by name."""
    if "baseline_m" in top:
        half = 0.5 * top.number("baseline_m", minimum=0.01, maximum=_FAR_M)
        height_m = top.number("height_m", 1.5, minimum=-1000.0, maximum=1000.0)
        return {"left": (-half, 0.0, height_m), "right": (half, 0.0, height_m)}
    if "height_m" in top:
        raise top.fail("height_m", "it together with [[station]]", "the height as each station's third number")
    rows = top.values["station"]
    if not isinstance(rows, list) or not 2 <= len(rows) <= MAX_STATIONS:
        got = f"{len(rows)} of them" if isinstance(rows, list) else quoted(rows)
        raise top.fail("station", got, f"2 to {MAX_STATIONS} [[station]] tables")
    places: dict[str, tuple[float, float, float]] = {}
    for number, row in enumerate(rows, start=1):
        table = TomlTable(row, f"{top.where}: station {number}", SiteError)
        table.refuse_unknown({"name", "position_m"})
        name = shown(table.text("name", f"station{number}"))
        if name in places or not name.replace("_", "a").replace("-", "a").isalnum():
            raise table.fail("name", quoted(name), "letters, digits, - and _, different for each station")
        x, y, z = (float(v) for v in table.vector("position_m", 3))
        if max(abs(x), abs(y), abs(z)) > _FAR_M:
            raise table.fail("position_m", quoted([x, y, z]), f"three numbers of at most {_FAR_M:g} m")
        places[name] = (x, y, z)
    return places


def _lens(camera: TomlTable) -> Lens:
    """Read focal_px, or focal_mm and pixel_um, and the picture's size; the axis goes through its middle."""
    if "focal_px" in camera and ("focal_mm" in camera or "pixel_um" in camera):
        raise camera.fail("focal_px", "it together with focal_mm or pixel_um", "one of the two ways")
    if "focal_px" in camera:
        focal_px = camera.number("focal_px", above=0.0, maximum=1e7)
    else:
        focal_mm = camera.number("focal_mm", above=0.0)
        pixel_um = camera.number("pixel_um", above=0.0)
        _require_units(camera, focal_mm, pixel_um)
        focal_px = 1000.0 * focal_mm / pixel_um
        if not 1.0 <= focal_px <= 1e7:
            raise camera.fail("focal_mm", f"{focal_px:.3g} pixels of {pixel_um:g} µm", "1 to 10 million pixels")
    size = camera.vector("image_size_px", 2)
    if np.any(size < 1) or np.any(size != np.round(size)) or np.any(size > 65536):
        raise camera.fail("image_size_px", quoted(size.tolist()), "two whole numbers of pixels from 1 to 65536")
    return Lens(
        image_size_px=(int(size[0]), int(size[1])),
        focal_px=np.array([focal_px, focal_px]),
        principal_point_px=0.5 * (size - 1.0),
        distortion=np.zeros(5),
    )


def _require_units(camera: TomlTable, focal_mm: float, pixel_um: float) -> None:
    """Raise `SiteError` for a pixel or a focal length that is one in another unit; a view that is too wide is told."""
    for key, value, (least, most), unit, others in (
        ("pixel_um", pixel_um, _PIXEL_UM, "µm", {"mm": 1e3, "nm": 1e-3, "m": 1e6}),
        ("focal_mm", focal_mm, _FOCAL_MM, "mm", {"µm": 1e-3}),
    ):
        likely = [name for name, factor in others.items() if least <= factor * value <= most]
        if likely and not least <= value <= most:
            wanted = f"a finite number > 0, {least:g} to {most:g} {unit}; is it in {likely[0]}?"
            raise camera.fail(key, f"{value:g}", wanted)


def _with_quality(rig: Rig, calibration: TomlTable) -> Rig:
    """Return the rig with the site's calibration quality in place of its own, the same for every station."""
    names: list[str] = []
    variances: list[float] = []
    for key, (parameters, factor) in _QUALITY.items():
        sigma = factor * calibration.number(key, 0.0, minimum=0.0, maximum=_MOST_SIGMA)
        if sigma > 0.0:
            names += parameters
            variances += [sigma**2] * len(parameters)
    clock = ClockModel(sigma_s=calibration.number("camera_ptu_s", 0.0, minimum=0.0, maximum=_MOST_SIGMA))
    stations = tuple(
        replace(
            station,
            covariance_parameters=tuple(names),
            covariance=np.diag(np.array(variances)),
            ptu_clock=clock,
            camera_clock=None,
        )
        for station in rig.stations
    )
    return replace(rig, stations=stations, shared_covariance=ParameterCovariance.nothing())


def _aircraft(table: TomlTable) -> Aircraft:
    """Read the aircraft and its glide."""
    keys = {"span_m", "speed_m_s", "glide_deg", "touchdown_y_m", "x_m", "nose_height_m", "acceleration_psd_m2_s3"}
    table.refuse_unknown(keys)
    psd = table.vector("acceleration_psd_m2_s3", 3, (0.3, 0.6, 0.3))
    if np.any(psd < 0.0) or np.any(psd > 1e6):
        raise table.fail("acceleration_psd_m2_s3", quoted(psd.tolist()), "three numbers from 0 to a million")
    return Aircraft(
        span_m=table.number("span_m", minimum=0.01, maximum=200.0),
        speed_m_s=table.number("speed_m_s", minimum=0.1, maximum=1000.0),
        glide_rad=math.radians(table.number("glide_deg", 3.5, minimum=0.0, maximum=45.0)),
        touchdown_y_m=table.number("touchdown_y_m", 0.0, minimum=-_FAR_M, maximum=_FAR_M),
        x_m=table.number("x_m", 0.0, minimum=-_FAR_M, maximum=_FAR_M),
        nose_height_m=table.number("nose_height_m", 0.3, minimum=-1000.0, maximum=1000.0),
        acceleration_psd_m2_s3=(float(psd[0]), float(psd[1]), float(psd[2])),
    )


def _required(table: TomlTable) -> tuple[Requirement, ...]:
    """Read the accuracies that are wanted, each by its name."""
    wanted = []
    for name in table.values:
        x, y, z = (float(v) for v in table.vector(name, 3))
        if min(x, y, z) <= 0.0:
            raise table.fail(name, quoted([x, y, z]), "1 sigma of x, y, z in m, three numbers > 0")
        wanted.append(Requirement(name=shown(name), sigma_m=(x, y, z)))
    return tuple(wanted)
