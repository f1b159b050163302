"""The part of the command line that trains the learned channel: `groundstation train`."""

import argparse
import sys
from pathlib import Path

from groundstation.cli.command_arguments import Commands, add_command, add_result_folder, print_files
from groundstation.cli.number_arguments import count, positive_number, whole_number
from groundstation.cli.path_arguments import READ, READ_TEXT
from groundstation.cli.progress import ProgressLine
from groundstation.errors import InputError, UsageError

_TRAIN = """Train the learned channel: draw aircraft, birds and backgrounds of the train worlds
once, then windows of them, fit the network, and write its weights as ONNX with a card
of what they were made from. Goes on where an earlier run into the same folder was
interrupted. On a GPU where there is one."""
_MORE = """examples:
  groundstation train --out out/channel
  groundstation train --out out/channel --clips aircraft-clips --recording landing-1 --recording takeoff-1
  groundstation train --out out/no-gliders --without glider --steps 1600
  groundstation train --out out/more --first-world 450 --mine out/channel/aircraft.onnx --material-only
  groundstation train --out out/better --start out/channel/aircraft.onnx --hard --material out/more/material
  groundstation train --out out/own --pictures mine --start out/channel/aircraft.onnx --steps 300 --rate 5e-4

writes aircraft.onnx, without-KIND.onnx, card.json, log.csv, checkpoint.pt and material/.
Needs groundstation[train]. A core takes about half a second a step of 64 windows.

exit code: 0 done; 1 bad input; 2 wrong usage; 130 interrupted: the same command goes on"""


def add_train(commands: Commands) -> None:
    """Add `train`."""
    train = add_command(
        commands, "train", run_train, "drawn windows in, weights of the learned channel out", _TRAIN, _MORE
    )
    add_result_folder(train, ("aircraft.onnx", "card.json"))
    train.add_argument(
        "--clips", type=READ, metavar="DIR", help="folder of real clips, whose frames are backgrounds, too"
    )
    train.add_argument(
        "--recording",
        type=READ,
        metavar="SESSION",
        action="append",
        default=[],
        help="rendered session with masks.npz, whose windows are mixed in; may be repeated",
    )
    train.add_argument(
        "--pictures", type=READ, metavar="DIR", help="one's own labelled pictures: NAME.png, NAME.mask.png, noses.csv"
    )
    train.add_argument("--start", type=READ, metavar="ONNX", help="weights to begin with, to fine-tune them")
    train.add_argument(
        "--first-world", type=whole_number, metavar="N", default=0, help="number of the first train world (default: 0)"
    )
    train.add_argument(
        "--worlds", type=count, metavar="N", default=450, help="how many train worlds are drawn (default: 450)"
    )
    train.add_argument(
        "--scenes",
        type=count,
        metavar="N",
        default=170,
        help="in how many of the --worlds a background is drawn (default: 170)",
    )
    train.add_argument(
        "--filmed", type=count, metavar="N", default=200, help="how many of the --worlds are filmed (default: 200)"
    )
    train.add_argument(
        "--views", type=count, metavar="N", default=20, help="pictures of each of the --filmed worlds (default: 20)"
    )
    train.add_argument(
        "--mine", type=READ, metavar="ONNX", help="weights whose mistakes in the filmed worlds are learned, too"
    )
    train.add_argument(
        "--material",
        type=READ,
        metavar="DIR",
        action="append",
        default=[],
        help="the folder material/ of an earlier run, which is used as well; may be repeated",
    )
    train.add_argument("--material-only", action="store_true", help="make the material and do not train")
    _add_fit(train)


def _add_fit(train: argparse.ArgumentParser) -> None:
    """Add the options of fitting, and of what is left out."""
    train.add_argument(
        "--hard", action="store_true", help="show more often what the weights of --start err on; needs --start"
    )
    train.add_argument("--steps", type=count, metavar="N", default=4000, help="steps of training (default: 4000)")
    train.add_argument(
        "--rate", type=positive_number, metavar="R", default=3e-3, help="largest learning rate (default: 0.003)"
    )
    train.add_argument("--batch", type=count, metavar="N", default=64, help="windows in each step (default: 64)")
    train.add_argument(
        "--echo",
        type=count,
        metavar="N",
        default=1,
        help="steps for each batch that is drawn, of windows drawn lately, in other light (default: 1)",
    )
    train.add_argument(
        "--workers", type=count, metavar="N", default=1, help="processes; the result is the same (default: 1)"
    )
    train.add_argument("--seed", type=count, metavar="N", default=1, help="seed of weights and windows (default: 1)")
    train.add_argument(
        "--leave-out",
        type=READ_TEXT,
        metavar="KIND",
        action="append",
        default=[],
        help="train a further network without the windows of a kind, into without-KIND.onnx; may be repeated",
    )
    train.add_argument(
        "--without",
        type=READ_TEXT,
        metavar="KIND",
        action="append",
        default=[],
        help="airframe family, scenery or sky that is left out; may be repeated",
    )


def _kinds(options: argparse.Namespace) -> dict[str, tuple[str, ...]]:
    """Return the kinds that are left out of the material, by what they are of."""
    from groundstation.simulation.airframes.kinds import AirframeFamily
    from groundstation.simulation.scenery import SceneryName, SkyName

    kinds = {
        "families": {kind.value for kind in AirframeFamily},
        "sceneries": {kind.value for kind in SceneryName},
        "skies": {kind.value for kind in SkyName},
    }
    for option, words in (("--without", options.without), ("--leave-out", options.leave_out)):
        unknown = [word for word in words if not any(word in names for names in kinds.values())]
        if unknown:
            wanted = "; ".join(f"{name}: {', '.join(sorted(names))}" for name, names in kinds.items())
            raise UsageError(option, got=", ".join(unknown), wanted=wanted)
    return {name: tuple(word for word in options.without if word in names) for name, names in kinds.items()}


def run_train(options: argparse.Namespace) -> int:
    """Train and say where the weights are; returns the exit code."""
    try:
        from training.fit import FitSettings
        from training.request import TrainRequest, material_of, train
    except ModuleNotFoundError as fault:
        raise InputError("train", got=str(fault), wanted="pip install 'groundstation[train]'") from fault
    from training.material import MaterialRequest

    if options.hard and options.start is None:
        raise UsageError("--hard", got="no --start", wanted="the weights whose errors show what is hard")
    without = _kinds(options)
    request = TrainRequest(
        out=options.out,
        material=MaterialRequest(
            worlds=options.worlds,
            first=options.first_world,
            pictures=options.views,
            mined_with=options.mine,
            scenes=options.scenes,
            filmed=options.filmed,
            clips=options.clips,
            without_families=without["families"],
            without_sceneries=without["sceneries"],
            without_skies=without["skies"],
        ),
        further=tuple(Path(folder) for folder in options.material),
        recordings=tuple(Path(folder) for folder in options.recording),
        pictures=options.pictures,
        start=options.start,
        fit=FitSettings(
            seed=options.seed,
            steps=options.steps,
            batch=options.batch,
            rate=options.rate,
            echo=options.echo,
            hard=options.hard,
            leave_out=tuple(options.leave_out),
        ),
        workers=options.workers,
    )
    if options.material_only:
        with ProgressLine(sys.stderr, "train", "world") as line:
            folder = material_of(request, lambda _, done, total: line.update(done, total))
        print(f"material in {folder}")
        return 0
    with ProgressLine(sys.stderr, "train", "step") as line:
        trained = train(request, lambda _, done, total: line.update(done, total))
    print(f"weights {trained.sha256}")
    print_files((trained.weights, trained.card))
    return 0
