"""The air at a site, by which light of stars is refracted: [air] of a session, a station file or a site file."""

from dataclasses import dataclass

from groundstation.files.toml_table import TomlTable


@dataclass(frozen=True, slots=True, kw_only=True)
class SiteAir:
    """Pressure at the site (not reduced to sea level) and temperature; None: the standard atmosphere's."""

    pressure_hpa: float | None = None
    air_c: float | None = None

    def keys(self) -> dict[str, float]:
        """Return the keys of a table [air] that are known."""
        known = {"pressure_hpa": self.pressure_hpa, "air_c": self.air_c}
        return {key: value for key, value in known.items() if value is not None}


def parse_air(table: TomlTable) -> SiteAir:
    """Parse [air]; raises the table's error."""
    table.refuse_unknown({"pressure_hpa", "air_c"})
    return SiteAir(
        pressure_hpa=table.number("pressure_hpa", minimum=300.0, maximum=1100.0) if "pressure_hpa" in table else None,
        air_c=table.number("air_c", minimum=-60.0, maximum=60.0) if "air_c" in table else None,
    )
