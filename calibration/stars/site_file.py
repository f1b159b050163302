"""Where the runway frame lies on Earth, for a calibration by stars: the [origin] of a session or station file."""

from pathlib import Path

from calibration.stars.sky import ObservingSite
from groundstation.errors import InputError, SessionError
from groundstation.files.toml_table import TomlTable, load_toml
from groundstation.session.site_air import SiteAir, parse_air

_ORIGIN_KEYS = ("lat_deg", "lon_deg", "height_m", "y_axis_azimuth_deg")


def read_site(path: Path) -> ObservingSite:
    """Return the site of a TOML file with a table [origin], and [air] where it has one; raises `InputError`.

    session.toml and a station file have such a table; other tables are left alone.
    """
    document = load_toml(path, SessionError)
    top = TomlTable(document, str(path), SessionError)
    if "origin" not in top:
        wanted = "a table [origin] with " + ", ".join(_ORIGIN_KEYS)
        raise InputError(str(path), got="no [origin]", wanted=wanted)
    origin = top.table("origin")
    air = parse_air(top.table("air")) if "air" in top else SiteAir()
    return ObservingSite(
        lat_deg=origin.number("lat_deg", minimum=-90.0, maximum=90.0),
        lon_deg=origin.number("lon_deg", minimum=-360.0, maximum=360.0),
        height_m=origin.number("height_m", minimum=-500.0, maximum=9000.0),
        y_axis_azimuth_deg=origin.number("y_axis_azimuth_deg", minimum=-360.0, maximum=360.0),
        pressure_hpa=air.pressure_hpa,
        air_c=air.air_c,
    )


def site_to_toml(site: ObservingSite) -> str:
    """Return a site as such a file."""
    lines = ["[origin]", *(f"{key} = {getattr(site, key):.12g}" for key in _ORIGIN_KEYS)]
    measured = SiteAir(pressure_hpa=site.pressure_hpa, air_c=site.air_c)
    air = [f"{key} = {value:g}" for key, value in measured.keys().items()]
    return "\n".join([*lines, *(["", "[air]", *air] if air else []), ""])
