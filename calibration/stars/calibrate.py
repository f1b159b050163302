"""The whole job of `groundstation calibrate stars`: a night's pictures in, a better rig out."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from calibration.joint_covariance import with_covariance
from calibration.stars.head_start import StarFitError
from calibration.stars.identified_stars import SkyUncertainty
from calibration.stars.joint_night import JointNight, rig_covariance, solve_jointly
from calibration.stars.night import StarPicture
from calibration.stars.sky import ObservingSite, SkyOverSite, decimal_year
from calibration.stars.star_solver import StarSolver
from calibration.stars.station_night import fit_station, with_change
from groundstation.errors import InputError, RigError, os_words
from groundstation.files.whole_file import write_whole
from groundstation.rig.covariance import ParameterCovariance
from groundstation.rig.rig import Rig, Station
from groundstation.rig.rig_toml import rig_to_toml

# a computer's clock by NTP is some ms off, a camera's stamp some 10 ms; of refraction, what a forecast's pressure and
# temperature leave open, and what the standard atmosphere does
CLOCK_SIGMA_S = 0.1
REFRACTION_SHARE_MEASURED, REFRACTION_SHARE_STANDARD = 0.01, 0.04


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NightCalibration:
    """The result: the joint solution, the rig with it, the stations without pictures, site and first and last time."""

    joint: JointNight
    rig: Rig
    without: tuple[str, ...]
    site: ObservingSite
    span_utc_s: tuple[float, float]

    @property
    def stations(self) -> tuple[Station, ...]:
        """The calibrated stations, as they are in the rig."""
        return tuple(self.rig[night.before.name] for night in self.joint.nights)


def sky_uncertainty(
    site: ObservingSite, clock_sigma_s: float, *, each_clock: bool, station_clocks: bool = False
) -> SkyUncertainty:
    """Return what is uncertain of the sky over a site."""
    measured = site.pressure_hpa is not None and site.air_c is not None
    share = REFRACTION_SHARE_MEASURED if measured else REFRACTION_SHARE_STANDARD
    return SkyUncertainty(clock_s=clock_sigma_s, refraction=share, each_clock=each_clock, station_clocks=station_clocks)


def calibrate_night(
    rig: Rig,
    pictures: Mapping[str, Sequence[StarPicture]],
    site: ObservingSite,
    uncertain: SkyUncertainty,
    progress: Callable[[str], None] = lambda station: None,
) -> NightCalibration:
    """Calibrate every station that has pictures; raises `StarFitError`, `RigError` and `MissingExtraError`."""
    if not pictures:
        raise StarFitError("got no picture of any station; wanted some 24 of each")
    sky = SkyOverSite(site)
    times = [picture.utc_s for own in pictures.values() for picture in own]
    nights = []
    for name, own in pictures.items():
        station = rig[name]
        if station.fixed:
            raise RigError(f"station {name}", got="a station without PTU", wanted="one that turns")
        solver = StarSolver(station.lens, decimal_year(times))
        nights.append(
            fit_station(station, own, solver, sky, uncertain, lambda name=name: progress(name))  # type: ignore[misc]
        )
    joint = solve_jointly(nights, station_clocks=uncertain.station_clocks)
    return NightCalibration(
        joint=joint,
        rig=_rig(rig, joint),
        without=tuple(n for n in rig.names if n not in pictures),
        site=site,
        span_utc_s=(min(times), max(times)),
    )


def _rig(rig: Rig, joint: JointNight) -> Rig:
    """Return the rig with the estimates and their covariance; what a night does not tell keeps the rig's."""
    after = {
        night.before.name: with_change(night, change) for night, change in zip(joint.nights, joint.change, strict=True)
    }
    found = rig_covariance(joint)
    return with_covariance(
        replace(rig, stations=tuple(after.get(s.name, s) for s in rig.stations)),
        ParameterCovariance(names=found.names, matrix=found.matrix),
    )


def write_night_rig(path: Path, found: NightCalibration) -> None:
    """Write the rig file; raises `InputError` where it cannot be written."""
    notes = [
        f"# {night.before.name} by stars: {int(night.fit.kept.sum())} in {len(night.pictures)} pictures"
        for night in found.joint.nights
    ]
    write_noted_rig(path, found.rig, notes)


def write_noted_rig(path: Path, rig: Rig, notes: Sequence[str]) -> None:
    """Write a rig file below lines of comment; raises `InputError` where it cannot be written."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, "\n".join([*notes, ""]) + rig_to_toml(rig))
    except OSError as error:
        raise InputError(str(path), got=os_words(error), wanted="a file that can be written") from error
