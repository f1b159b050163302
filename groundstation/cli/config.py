"""`groundstation config`: the tuning with its defaults, as TOML."""

import argparse

from groundstation.cli.command_arguments import Commands, add_command
from groundstation.cli.path_arguments import READ

_CONFIG = """Print the whole tuning as TOML, with every default that FILE does not
change, and the meaning and the bounds of each key: a file to start from for
replay's --config."""


def add_config(commands: Commands) -> None:
    """Add `config`."""
    config = add_command(commands, "config", run_config, "print the tuning with its defaults, as TOML", _CONFIG)
    config.add_argument("--config", type=READ, metavar="FILE", help="what differs from the defaults, TOML")


def run_config(options: argparse.Namespace) -> int:
    """Print the resolved tuning."""
    from groundstation.tracking.config import load_config
    from groundstation.tracking.config_comments import commented_toml

    print(commented_toml(load_config(options.config)))
    return 0
