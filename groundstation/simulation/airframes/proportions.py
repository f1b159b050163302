"""Proportions of the airframes of each family: ranges about those of aircraft of up to some 150 kg."""

from dataclasses import dataclass

from groundstation.simulation.airframes.kinds import AirframeFamily, GearKind, PropellerKind, TailKind

Range = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Proportions:
    """Ranges of a family's parameters; lengths in wing spans, angles in degrees.

    ``place`` is how far behind the nose a quarter of the mean chord is, as a share of the fuselage's length; a delta's
    and a flying wing's follow from its chord.
    """

    span_m: Range = (1.2, 6.0)
    length: Range = (0.58, 0.8)
    width: Range = (0.06, 0.105)
    height: Range = (0.075, 0.13)
    squareness: Range = (0.0, 0.8)
    full_from: Range = (0.14, 0.28)
    full_to: Range = (0.42, 0.58)
    end_share: Range = (0.16, 0.4)
    taper_power: Range = (0.9, 1.6)
    rise: Range = (0.0, 0.2)
    end_rise: Range = (0.1, 0.4)
    canopy: Range = (0.15, 0.3)
    canopy_chance: float = 0.5
    ball_chance: float = 0.2
    aspect_ratio: Range = (5.5, 9.5)
    taper: Range = (0.55, 1.0)
    straight: Range = (0.2, 0.7)
    sweep_deg: Range = (0.0, 4.0)
    dihedral_deg: Range = (0.0, 3.5)
    tip_dihedral_deg: Range = (0.0, 2.0)
    thickness: Range = (0.1, 0.15)
    place: Range = (0.29, 0.36)
    wing_height: Range = (0.75, 1.0)
    winglet: Range = (0.03, 0.07)
    winglet_chance: float = 0.1
    strut_chance: float = 0.0
    tail_area: Range = (0.15, 0.23)
    tail_aspect_ratio: Range = (3.2, 5.0)
    fin_area: Range = (0.08, 0.13)
    fin_aspect_ratio: Range = (1.0, 1.7)
    fin_sweep_deg: Range = (5.0, 40.0)
    v_angle_deg: Range = (32.0, 45.0)
    spacing: Range = (0.22, 0.34)
    tail_end: Range = (0.62, 0.85)
    propeller: Range = (0.075, 0.12)
    tails: tuple[TailKind, ...] = (TailKind.CONVENTIONAL,)
    propellers: tuple[PropellerKind, ...] = (PropellerKind.TRACTOR,)
    gears: tuple[GearKind, ...] = (GearKind.TRICYCLE, GearKind.TAIL_WHEEL)


_LEGS = (GearKind.TRICYCLE, GearKind.TAIL_WHEEL)
_TRACTORS = (PropellerKind.TRACTOR, PropellerKind.TRACTOR, PropellerKind.TRACTOR, PropellerKind.PAIR)
_BEHIND = (PropellerKind.PUSHER, PropellerKind.PUSHER, PropellerKind.PUSHER, PropellerKind.TRACTOR)

PROPORTIONS: dict[AirframeFamily, Proportions] = {
    AirframeFamily.HIGH_WING: Proportions(
        tails=(TailKind.CONVENTIONAL, TailKind.CONVENTIONAL, TailKind.CONVENTIONAL, TailKind.TWIN_FIN),
        propellers=_TRACTORS,
        gears=(*_LEGS, *_LEGS, GearKind.SKIDS),
        strut_chance=0.4,
    ),
    AirframeFamily.LOW_WING: Proportions(
        wing_height=(-0.85, -0.5),
        rise=(-0.05, 0.12),
        canopy=(0.18, 0.32),
        canopy_chance=0.85,
        dihedral_deg=(2.5, 7.0),
        tip_dihedral_deg=(0.0, 1.0),
        taper=(0.45, 1.0),
        propellers=_TRACTORS,
        ball_chance=0.0,
    ),
    AirframeFamily.TWIN_BOOM: Proportions(
        length=(0.4, 0.55),
        full_from=(0.25, 0.4),
        full_to=(0.55, 0.75),
        end_share=(0.4, 0.75),
        end_rise=(0.0, 0.3),
        aspect_ratio=(7.0, 13.0),
        place=(0.58, 0.68),
        wing_height=(0.6, 1.0),
        straight=(0.35, 0.7),
        tails=(TailKind.TWIN_FIN, TailKind.TWIN_FIN, TailKind.INVERTED_V),
        propellers=_BEHIND,
        propeller=(0.07, 0.1),
        gears=(GearKind.TRICYCLE, GearKind.TRICYCLE, GearKind.TRICYCLE, GearKind.SKIDS),
        canopy_chance=0.15,
        ball_chance=0.5,
    ),
    AirframeFamily.V_TAIL: Proportions(
        length=(0.5, 0.7),
        width=(0.05, 0.085),
        height=(0.06, 0.1),
        aspect_ratio=(7.0, 14.0),
        taper=(0.4, 0.9),
        place=(0.36, 0.44),
        wing_height=(0.2, 1.0),
        tail_area=(0.2, 0.32),
        tail_aspect_ratio=(3.5, 5.5),
        end_share=(0.25, 0.45),
        tails=(TailKind.V, TailKind.V, TailKind.V, TailKind.INVERTED_V),
        propellers=(PropellerKind.TRACTOR, PropellerKind.PUSHER),
        propeller=(0.06, 0.1),
        gears=(GearKind.TRICYCLE, GearKind.TRICYCLE, GearKind.SKIDS, GearKind.NONE),
        canopy_chance=0.3,
        ball_chance=0.4,
    ),
    AirframeFamily.T_TAIL: Proportions(
        length=(0.5, 0.7),
        width=(0.05, 0.09),
        height=(0.06, 0.1),
        aspect_ratio=(7.0, 15.0),
        taper=(0.4, 0.9),
        place=(0.34, 0.42),
        wing_height=(-0.7, 1.0),
        fin_area=(0.09, 0.14),
        fin_sweep_deg=(15.0, 45.0),
        propellers=_TRACTORS,
        propeller=(0.06, 0.1),
        tails=(TailKind.T,),
        gears=(GearKind.TRICYCLE, GearKind.TRICYCLE, GearKind.TAIL_WHEEL),
    ),
    AirframeFamily.GLIDER: Proportions(
        span_m=(2.0, 6.0),
        length=(0.36, 0.5),
        width=(0.032, 0.05),
        height=(0.04, 0.065),
        full_from=(0.14, 0.24),
        full_to=(0.34, 0.44),
        end_share=(0.14, 0.24),
        taper_power=(1.8, 3.2),
        end_rise=(0.2, 0.45),
        canopy=(0.2, 0.32),
        canopy_chance=0.8,
        ball_chance=0.0,
        aspect_ratio=(14.0, 24.0),
        taper=(0.35, 0.7),
        dihedral_deg=(0.5, 3.0),
        tip_dihedral_deg=(1.0, 7.0),
        place=(0.34, 0.4),
        wing_height=(0.2, 0.9),
        winglet_chance=0.3,
        winglet=(0.015, 0.035),
        tail_area=(0.11, 0.16),
        tail_aspect_ratio=(4.0, 6.5),
        fin_area=(0.06, 0.09),
        fin_aspect_ratio=(1.2, 2.0),
        fin_sweep_deg=(0.0, 25.0),
        tails=(TailKind.T, TailKind.CONVENTIONAL, TailKind.V),
        propellers=(PropellerKind.NONE, PropellerKind.NONE, PropellerKind.TRACTOR),
        propeller=(0.045, 0.07),
        gears=(GearKind.SINGLE_WHEEL, GearKind.SINGLE_WHEEL, GearKind.NONE, GearKind.SKIDS),
    ),
    AirframeFamily.FLYING_WING: Proportions(
        span_m=(1.2, 3.6),
        width=(0.07, 0.13),
        height=(0.045, 0.08),
        full_from=(0.25, 0.45),
        full_to=(0.5, 0.65),
        end_share=(0.25, 0.5),
        rise=(-0.1, 0.1),
        end_rise=(0.0, 0.2),
        canopy_chance=0.2,
        aspect_ratio=(4.5, 9.5),
        taper=(0.35, 0.75),
        straight=(0.0, 0.25),
        sweep_deg=(20.0, 36.0),
        dihedral_deg=(0.0, 2.0),
        wing_height=(-0.3, 0.4),
        winglet_chance=0.85,
        winglet=(0.05, 0.12),
        fin_area=(0.05, 0.09),
        tails=(TailKind.NONE,),
        propellers=(*_BEHIND, PropellerKind.NONE),
        propeller=(0.07, 0.11),
        gears=(GearKind.NONE, GearKind.SKIDS, GearKind.TRICYCLE),
    ),
    AirframeFamily.DELTA: Proportions(
        span_m=(1.2, 3.2),
        width=(0.08, 0.14),
        height=(0.07, 0.13),
        full_from=(0.25, 0.4),
        full_to=(0.6, 0.8),
        end_share=(0.4, 0.7),
        rise=(-0.1, 0.1),
        end_rise=(0.0, 0.15),
        aspect_ratio=(1.9, 3.2),
        taper=(0.06, 0.3),
        straight=(0.0, 0.0),
        sweep_deg=(-8.0, 6.0),  # of the trailing edge
        dihedral_deg=(-1.0, 2.0),
        thickness=(0.05, 0.08),
        wing_height=(-0.6, 0.2),
        winglet_chance=0.0,
        fin_area=(0.09, 0.15),
        fin_aspect_ratio=(0.8, 1.4),
        fin_sweep_deg=(30.0, 50.0),
        spacing=(0.3, 0.55),
        tails=(TailKind.FIN, TailKind.TWIN_FIN),
        propellers=(PropellerKind.PUSHER, PropellerKind.PUSHER, PropellerKind.TRACTOR, PropellerKind.NONE),
        gears=(GearKind.TRICYCLE, GearKind.TRICYCLE, GearKind.SKIDS),
        canopy_chance=0.6,
    ),
    AirframeFamily.CANARD: Proportions(
        length=(0.6, 0.8),
        full_from=(0.3, 0.45),
        full_to=(0.6, 0.75),
        end_share=(0.45, 0.7),
        rise=(-0.05, 0.1),
        end_rise=(0.0, 0.2),
        aspect_ratio=(6.0, 10.0),
        taper=(0.4, 0.7),
        straight=(0.0, 0.2),
        sweep_deg=(14.0, 30.0),
        dihedral_deg=(0.0, 3.0),
        place=(0.74, 0.82),
        wing_height=(-0.6, 0.7),
        winglet_chance=1.0,
        winglet=(0.07, 0.13),
        fin_area=(0.07, 0.12),
        tails=(TailKind.NONE, TailKind.NONE, TailKind.FIN),
        propellers=(PropellerKind.PUSHER, PropellerKind.PUSHER, PropellerKind.PUSHER, PropellerKind.TRACTOR),
        propeller=(0.07, 0.105),
        gears=(GearKind.TRICYCLE,),
        canopy_chance=0.7,
        ball_chance=0.0,
    ),
}
