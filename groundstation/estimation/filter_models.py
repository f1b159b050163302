"""The models of one filter: state layout, motion modes, measurement updates."""

import math
from collections.abc import Mapping

from groundstation.estimation.config import EstimationConfig, OutOfViewWeighting
from groundstation.estimation.consider_parameters import ConsiderPolicy
from groundstation.estimation.implementation import filter_arithmetic
from groundstation.estimation.linearisation import PixelLinearisation
from groundstation.estimation.motion import MotionModel, MotionModes
from groundstation.estimation.parameters import ParameterPrior
from groundstation.estimation.state_model import StateLayout, state_layout
from groundstation.estimation.target_start import TargetStarter
from groundstation.estimation.updates.miss_update import MissUpdate
from groundstation.estimation.updates.pixel_model import PixelModel
from groundstation.estimation.updates.pixel_update import PixelUpdate
from groundstation.estimation.updates.reference_update import ReferencePositionUpdate
from groundstation.estimation.updates.width_update import WidthUpdate
from groundstation.geometry.station import StationGeometry


class FilterModels:
    """Models for the stations of a rig; constant during a flight.

    Parameters
    ----------
    stations : geometry of every station by name.
    turning : names of the stations that have a PTU.
    config : tuning.
    prior : of the carried errors of calibration and clocks.
    """

    def __init__(
        self,
        stations: Mapping[str, StationGeometry],
        turning: tuple[str, ...],
        config: EstimationConfig,
        prior: ParameterPrior,
    ) -> None:
        self.arithmetic = filter_arithmetic(config.implementation)
        prior.require_stations(tuple(stations))
        correlated = tuple(stations) if config.detection_lasting_share > 0.0 else ()
        self.layout: StateLayout = state_layout(turning, prior.names, correlated)
        psds = [config.acceleration_psd_m2_s3]
        if config.manoeuvre_psd_m2_s3 != config.acceleration_psd_m2_s3:
            psds.append(config.manoeuvre_psd_m2_s3)
        # the paper's filter knows no cameras that are alone
        paper = config.out_of_view is OutOfViewWeighting.PAPER
        self.alone_after_s = math.inf if paper else config.alone_after_s
        noise, walk = config.ptu_acceleration_psd_rad2_s3, prior.walk_psd
        models = [MotionModel(self.layout, psd, noise, walk, config.detection_lasting_s) for psd in psds]
        self.motion = MotionModes(models, (config.steady_s, config.manoeuvre_s)[: len(models)])
        self.pixels = {name: PixelModel(self.layout, geometry) for name, geometry in stations.items()}
        linearisation = PixelLinearisation(self.layout, self.pixels)
        steady = self.motion.steady
        self.start = TargetStarter(self.layout, prior, linearisation, self.motion.manoeuvre)
        self.pixel = PixelUpdate(self.layout, config, stations, linearisation, steady)
        self.encoder = {name: self.arithmetic.encoder(self.layout, name, config) for name in turning}
        self.reference = ReferencePositionUpdate(self.layout, config, steady)
        self.width = WidthUpdate(self.layout, stations, config, prior)
        self.miss = MissUpdate(stations, self.pixels)
        self.consider = ConsiderPolicy(self.layout, config, stations)
