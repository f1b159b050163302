"""Airframes drawn at random, with the proportions of their family."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from groundstation.simulation.airframes.draw_livery import draw_livery
from groundstation.simulation.airframes.equipment_specs import GearSpec, LightsSpec, PropellerSpec
from groundstation.simulation.airframes.kinds import AirframeFamily, GearKind, PropellerKind
from groundstation.simulation.airframes.part_specs import ForeplaneSpec, HullSpec, TailSpec, WingSpec
from groundstation.simulation.airframes.proportions import PROPORTIONS, Proportions, Range
from groundstation.simulation.airframes.spec import AirframeSpec
from groundstation.simulation.parameter_checks import require

_T = TypeVar("_T")
# a propeller's tips clear booms and tail by this, in spans
_TIP_ROOM = 0.024
_DARK_BLADES, _GREY_BLADES = 30.0, 110.0


def draw_airframe(generator: np.random.Generator, families: Sequence[AirframeFamily]) -> AirframeSpec:
    """Return an airframe of one of these families, each as likely."""
    require(len(families) > 0, "draw_airframe: families", got="none", wanted="one or more")
    family = families[int(generator.integers(len(families)))]
    return _Draw(generator, family).airframe()


class _Draw:
    """One airframe's draw: its generator and its family's proportions."""

    def __init__(self, generator: np.random.Generator, family: AirframeFamily) -> None:
        self._generator = generator
        self._family = family
        self._of: Proportions = PROPORTIONS[family]

    def airframe(self) -> AirframeSpec:
        """Return all parts, each drawn to fit those before it."""
        low, high = self._of.span_m
        span_m = math.exp(self._within((math.log(low), math.log(high))))
        propeller = self._one(self._of.propellers)
        hull = self._hull()
        wing, length = self._wing(hull, propeller)
        tail = self._tail(length)
        if self._family is AirframeFamily.V_TAIL and propeller is PropellerKind.PUSHER:
            # the propeller turns behind the tail
            tail = replace(tail, end_per_span=length - 0.015)
        hull = replace(hull, length_per_span=length)
        return AirframeSpec(
            family=self._family,
            span_m=span_m,
            hull=hull,
            wing=wing,
            tail=tail,
            foreplane=self._foreplane(length) if self._family is AirframeFamily.CANARD else None,
            propeller=self._propeller(propeller, tail),
            gear=self._gear(hull, span_m),
            livery=draw_livery(self._generator),
            lights=self._lights(span_m),
        )

    def _within(self, limits: Range) -> float:
        return float(self._generator.uniform(*limits))

    def _one(self, options: Sequence[_T]) -> _T:
        return options[int(self._generator.integers(len(options)))]

    def _chance(self, probability: float) -> bool:
        return bool(self._generator.random() < probability)

    def _angle(self, limits_deg: Range) -> float:
        return math.radians(self._within(limits_deg))

    def _hull(self) -> HullSpec:
        of = self._of
        full_from = self._within(of.full_from)
        has_canopy, canopy = self._chance(of.canopy_chance), self._within(of.canopy)
        return HullSpec(
            length_per_span=self._within(of.length),
            width_per_span=self._within(of.width),
            height_per_span=self._within(of.height),
            bluntness=self._within((0.1, 1.0)),
            squareness=self._within(of.squareness),
            full_from=full_from,
            full_to=self._within(of.full_to),
            end_share=self._within(of.end_share),
            taper_power=self._within(of.taper_power),
            rise=self._within(of.rise),
            end_rise=self._within(of.end_rise),
            canopy_share=canopy if has_canopy else 0.0,
            sensor_ball=self._chance(of.ball_chance),
        )

    def _wing(self, hull: HullSpec, propeller: PropellerKind) -> tuple[WingSpec, float]:
        """Return the wing and the fuselage's length, which for a flying wing or a delta follows from the chord."""
        of = self._of
        dihedral = self._angle(of.dihedral_deg)
        has_winglets, winglet = self._chance(of.winglet_chance), self._within(of.winglet)
        aspect_ratio, taper, straight = self._within(of.aspect_ratio), self._within(of.taper), self._within(of.straight)
        edge = self._angle(of.sweep_deg)
        place, share = self._within(of.place), self._generator.random()
        mean = straight + (1.0 - straight) * 0.5 * (1.0 + taper)
        chord, length = 1.0 / (aspect_ratio * mean), hull.length_per_span
        sweep = edge
        if self._family is AirframeFamily.DELTA:
            sweep = math.atan(math.tan(edge) + 2.0 * (1.0 - taper) * chord)
            lead = 0.08 + 0.2 * share
            length = lead + 1.02 * chord
        elif self._family is AirframeFamily.FLYING_WING:
            lead = 0.02 + 0.1 * share
            length = lead + (1.0 + 0.1 * share) * chord
        else:
            # a quarter of the mean chord is at 0.42 of the half span
            lead = max(place * length - 0.25 * chord * mean - 0.21 * math.tan(sweep), 0.06)
        behind = max(math.tan(sweep) - 2.0 * (1.0 - taper) * chord, 0.0)
        if propeller is PropellerKind.PUSHER and self._family is not AirframeFamily.V_TAIL:
            # the trailing edge stays before the disc
            length = max(length, lead + chord + behind * of.propeller[1])
        wing = WingSpec(
            aspect_ratio=aspect_ratio,
            taper=taper,
            straight_share=straight,
            sweep_rad=sweep,
            dihedral_rad=dihedral,
            tip_dihedral_rad=dihedral + self._angle(of.tip_dihedral_deg),
            thickness=self._within(of.thickness),
            lead_per_span=lead,
            height=self._within(of.wing_height),
            winglet_per_span=winglet if has_winglets else 0.0,
            winglet_cant_rad=self._within((0.0, 0.3)),
            struts=self._chance(of.strut_chance),
        )
        return wing, length

    def _tail(self, length: float) -> TailSpec:
        of, kind = self._of, self._one(self._of.tails)
        spacing = self._within(of.spacing)
        end = self._within(of.tail_end) if self._family is AirframeFamily.TWIN_BOOM else length
        return TailSpec(
            kind=kind,
            end_per_span=max(end, length + 0.12) if self._family is AirframeFamily.TWIN_BOOM else end,
            area_share=self._within(of.tail_area),
            aspect_ratio=self._within(of.tail_aspect_ratio),
            taper=self._within((0.5, 1.0)),
            sweep_rad=self._angle((0.0, 14.0)),
            fin_area_share=self._within(of.fin_area),
            fin_aspect_ratio=self._within(of.fin_aspect_ratio),
            fin_taper=self._within((0.4, 0.8)),
            fin_sweep_rad=self._angle(of.fin_sweep_deg),
            v_angle_rad=self._angle(of.v_angle_deg),
            fin_spacing_per_span=spacing,
        )

    def _foreplane(self, length: float) -> ForeplaneSpec:
        return ForeplaneSpec(
            lead_per_span=length * self._within((0.06, 0.14)),
            area_share=self._within((0.12, 0.22)),
            aspect_ratio=self._within((4.0, 7.0)),
            taper=self._within((0.5, 1.0)),
            sweep_rad=self._angle((0.0, 15.0)),
            height=self._within((-0.4, 0.6)),
        )

    def _propeller(self, kind: PropellerKind, tail: TailSpec) -> PropellerSpec:
        radius = self._within(self._of.propeller)
        if self._family is AirframeFamily.TWIN_BOOM:
            radius = min(radius, 0.5 * tail.fin_spacing_per_span - _TIP_ROOM)
        grey = self._within((_DARK_BLADES, _GREY_BLADES))
        even, smear = self._chance(0.5), self._within((0.15, 0.95))
        return PropellerSpec(
            kind=kind,
            radius_per_span=radius,
            blades=self._one((2, 2, 2, 3, 3, 4)),
            smear_share=1.0 if even else smear,
            opacity=self._within((0.07, 0.22)),
            phase_rad=self._within((0.0, 2.0 * math.pi)),
            colour_bgr=(grey, grey, grey),
        )

    def _gear(self, hull: HullSpec, span_m: float) -> GearSpec:
        kind = self._one(self._of.gears)
        track = self._within((0.13, 0.24)) if kind is not GearKind.SKIDS else self._within((0.08, 0.14))
        # wheels grow less than the aircraft
        wheel = self._within((0.017, 0.024)) * (2.4 / span_m) ** 0.3
        return GearSpec(
            kind=kind,
            clearance_per_span=self._within((0.025, 0.055)),
            track_per_span=max(track, hull.width_per_span + 0.02),
            wheel_per_span=wheel,
        )

    def _lights(self, span_m: float) -> LightsSpec:
        """Return lights, which large aircraft have more often."""
        likely = min(0.15 + 0.12 * span_m, 0.75)
        has = self._generator.random(3) < likely
        navigation, strobe, landing = (math.exp(self._within(v)) for v in ((0.0, 2.5), (2.3, 5.0), (5.0, 8.5)))
        return LightsSpec(
            navigation_cd=navigation if has[0] else 0.0,
            strobe_cd=strobe if has[1] else 0.0,
            strobe_period_s=self._within((0.8, 1.6)),
            strobe_lit_share=self._within((0.05, 0.15)),
            landing_cd=landing if has[2] else 0.0,
        )
