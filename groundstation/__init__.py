"""Groundstation: where is the approaching aircraft, in 3-D, from two cameras on pan-tilt units.

From Python: `replay_session` replays a session and returns NumPy arrays (docs/python.md).
"""

# nothing is imported before `cli.start` stands ready for an interrupt; type checkers take this as true
TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.replay.replay_session import CameraSeries, ReplayedSession, replay_session

__version__ = "0.1.0"
# the public names; what is not here may change without a note
__all__ = ["CameraSeries", "ReplayedSession", "__version__", "replay_session"]


def __getattr__(name: str) -> object:
    """Import a public name when it is first used: the command line starts without what it does not need."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from groundstation.replay import replay_session as module

    return getattr(module, name)
