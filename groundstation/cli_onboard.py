"""The part of the command line for the aircraft's own camera: `groundstation onboard WHAT …`."""

import argparse
from collections.abc import Callable

from groundstation.cli_onboard_pose import add_pose, run_pose


def add_onboard(commands: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add `onboard` and its kinds."""
    onboard = commands.add_parser(
        "onboard",
        help="the aircraft's own camera: where it is relative to the runway",
        description="The aircraft's own camera: where it is relative to the runway.",
    )
    kinds = onboard.add_subparsers(dest="onboard", metavar="WHAT", required=True)
    add_pose(kinds)


def run_onboard(options: argparse.Namespace) -> int:
    """Run one kind; returns the exit code."""
    return _KINDS[options.onboard](options)


_KINDS: dict[str, Callable[[argparse.Namespace], int]] = {"pose": run_pose}
