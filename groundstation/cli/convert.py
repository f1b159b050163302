"""`groundstation convert`: between session folders, recordings and ROS 2 bags."""

import argparse
import sys

from groundstation.cli.command_arguments import Commands, add_command
from groundstation.cli.path_arguments import NEW_FOLDER, READ
from groundstation.cli.progress import ProgressLine
from groundstation.cli.time_span import add_span, require_span
from groundstation.errors import UsageError

_CONVERT = """Turn a session folder into a recording, or a recording into a session folder.
Into a recording go whole frames, without loss, which takes far more space than
the videos; a folder gets what a recording has as PNG pictures, black where
detection never looked. With --ros2 a ROS 2 bag is written; a bag as IN becomes
a session folder."""
_CONVERT_MORE = """examples:
  groundstation convert recordings/landing-1 landing-1.mcap --to 10
  groundstation convert flight.mcap flight/
  groundstation convert recordings/landing-1 out/bag --ros2 --run out/landing-1
  groundstation convert out/bag out/back
  groundstation convert bag flight --rig rig.toml --topic left.image=/cam0/image

KML and GeoJSON of the track are among the results of `groundstation replay` and
of `groundstation evaluate --out`.

exit code: 0 done; 1 the session is at fault, and what came before the fault is
written; 2 wrong usage; 130 interrupted"""


def add_convert(commands: Commands) -> None:
    """Add `convert`."""
    convert = add_command(
        commands,
        "convert",
        run_convert,
        "between session folders, recordings and ROS 2 bags",
        _CONVERT,
        _CONVERT_MORE,
    )
    convert.add_argument(
        "source",
        type=READ,
        metavar="IN",
        help="a session folder, a recording (.mcap), the folder of a live run, or a ROS 2 bag",
    )
    convert.add_argument(
        "out", type=NEW_FOLDER, metavar="OUT", help="the other: a file ending in .mcap, or a new folder"
    )
    add_span(convert)
    bags = convert.add_argument_group("ROS 2 bags (extra ros)")
    bags.add_argument("--ros2", action="store_true", help="write a ROS 2 bag, a new folder, instead")
    bags.add_argument(
        "--run",
        type=READ,
        dest="run_folder",
        metavar="DIR",
        help="with --ros2: the results of a replay, for their track",
    )
    bags.add_argument("--rig", type=READ, metavar="FILE", help="from a bag: the calibration of the stations")
    bags.add_argument(
        "--topic",
        action="append",
        type=_topic,
        default=[],
        metavar="NAME=TOPIC",
        help="from a bag: the topic of left.image, left.joints, reference …, else the one that names the station",
    )


def run_convert(options: argparse.Namespace) -> int:
    """Convert, and say what the new form does not have."""
    from groundstation.conversion.convert import convert
    from groundstation.conversion.ros_bag import from_ros_bag, is_ros_bag, to_ros_bag

    require_span(options)
    with ProgressLine(sys.stderr, "convert") as line:
        if is_ros_bag(options.source):
            _refuse(options, ("ros2", "run_folder", "from_s", "to_s"), "a ROS 2 bag in")
            done = from_ros_bag(
                options.source, options.out, rig=options.rig, topics=dict(options.topic), progress=line.update
            )
        elif options.ros2:
            _refuse(options, ("rig", "topic"), "--ros2")
            if options.out.suffix.lower() == ".mcap":
                raise UsageError(
                    "OUT", got=str(options.out), wanted="a new folder's name with --ros2: a bag is a folder"
                )
            span = {"from_s": options.from_s, "to_s": options.to_s}
            done = to_ros_bag(options.source, options.out, run=options.run_folder, **span, progress=line.update)
        else:
            _refuse(options, ("rig", "topic", "run_folder"), "a session without --ros2")
            done = convert(options.source, options.out, from_s=options.from_s, to_s=options.to_s, progress=line.update)
    for note in done.notes:
        print(f"note: {note}")
    print(f"wrote {done.out}: {done.events} events")
    if done.fault is not None:
        print(f"groundstation: fault in the session: {done.fault}", file=sys.stderr)
    return 0 if done.fault is None else 1


_OPTIONS = {
    "ros2": "--ros2",
    "run_folder": "--run",
    "from_s": "--from",
    "to_s": "--to",
    "rig": "--rig",
    "topic": "--topic",
}


def _refuse(options: argparse.Namespace, names: tuple[str, ...], what: str) -> None:
    """Raise `UsageError` for an option that means nothing here."""
    for name in names:
        if getattr(options, name):
            raise UsageError("convert", got=_OPTIONS[name], wanted=f"none of that with {what}")


def _topic(text: str) -> tuple[str, str]:
    """Return name and topic of NAME=TOPIC."""
    name, separator, topic = text.partition("=")
    if not (name and separator and topic):
        raise argparse.ArgumentTypeError(f"got {text!r}; wanted NAME=TOPIC, such as left.image=/cam0/image_raw")
    return name, topic
