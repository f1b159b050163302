"""`groundstation calibrate WHAT …`: calibration of lenses, mounts, poses and clocks."""

from groundstation.cli.calibrate_combine import add_combine
from groundstation.cli.calibrate_flight import add_flight
from groundstation.cli.calibrate_landmarks import add_landmark_kinds
from groundstation.cli.calibrate_lens import add_convert_lens, add_intrinsics
from groundstation.cli.calibrate_mount import add_mount
from groundstation.cli.calibrate_panorama import add_panorama
from groundstation.cli.calibrate_sightings import add_sightings
from groundstation.cli.calibrate_sky import add_sky
from groundstation.cli.calibrate_stars import add_stars
from groundstation.cli.calibrate_timing import add_timing
from groundstation.cli.command_arguments import Commands


def add_calibrate(commands: Commands) -> None:
    """Add `calibrate` and its subcommands."""
    calibrate = commands.add_parser(
        "calibrate", help="find what a rig file holds", description="Find what a rig file holds."
    )
    kinds = calibrate.add_subparsers(dest="calibrate", metavar="WHAT", required=True)
    add_flight(kinds)
    add_mount(kinds)
    add_timing(kinds)
    add_stars(kinds)
    add_sky(kinds)
    add_panorama(kinds)
    add_combine(kinds)
    add_sightings(kinds)
    add_landmark_kinds(kinds)
    add_intrinsics(kinds)
    add_convert_lens(kinds)
