"""`groundstation completion`: what a shell needs to complete commands, options, choices and paths."""

import argparse
from collections.abc import Iterator

from groundstation.cli.command_arguments import Commands, add_command
from groundstation.cli.path_arguments import PATH_TYPES

SHELLS = ("bash", "zsh", "tcsh")
_COMPLETION = """Print a script with which a shell completes the commands, options and
choices of groundstation, and paths where one is wanted."""
_COMPLETION_MORE = """examples:
  groundstation completion bash
  groundstation completion zsh

Bash reads ~/.local/share/bash-completion/completions/groundstation, zsh a file
_groundstation in a folder of $fpath; print it there again after an update."""


def add_completion(commands: Commands) -> None:
    """Add `completion`."""
    completion = add_command(
        commands,
        "completion",
        run_completion,
        "print what a shell needs to complete commands and options",
        _COMPLETION,
        _COMPLETION_MORE,
    )
    completion.add_argument("shell", choices=SHELLS, metavar="SHELL", help="bash, zsh or tcsh")


def run_completion(options: argparse.Namespace) -> int:
    """Print the script."""
    import shtab

    from groundstation.cli.main import build_parser

    parser = build_parser()
    for action in _actions(parser):
        if isinstance(action.type, PATH_TYPES):
            action.complete = shtab.FILE  # type: ignore[attr-defined]
    print(shtab.complete(parser, shell=options.shell))
    return 0


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """Yield the arguments of all commands."""
    for action in parser._actions:
        yield action
        if isinstance(action, argparse._SubParsersAction):
            for child in action.choices.values():
                yield from _actions(child)
