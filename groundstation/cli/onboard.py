"""`groundstation onboard WHAT …`: processing of the aircraft's own camera."""

from groundstation.cli.command_arguments import Commands
from groundstation.cli.onboard_edges import add_edges
from groundstation.cli.onboard_fly import add_fly
from groundstation.cli.onboard_pose import add_pose
from groundstation.cli.onboard_render import add_render


def add_onboard(commands: Commands) -> None:
    """Add `onboard` and its subcommands."""
    onboard = commands.add_parser("onboard", help="the aircraft's own camera: runway edges, runway pose, trajectory")
    kinds = onboard.add_subparsers(dest="what", metavar="WHAT", required=True)
    add_edges(kinds)
    add_pose(kinds)
    add_fly(kinds)
    add_render(kinds)
