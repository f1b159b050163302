"""The part of the command line that trains the proposal network: `groundstation train-proposals`."""

import argparse
import sys

from groundstation.cli.command_arguments import Commands, add_command, add_result_folder, print_files
from groundstation.cli.number_arguments import count, positive_number, whole_number
from groundstation.cli.path_arguments import READ
from groundstation.cli.progress import ProgressLine
from groundstation.errors import InputError

_TRAIN = """Train the proposal network, which says where in a whole picture an aircraft may be:
film train worlds once, then crops of these pictures, fit the network, and write its
weights as ONNX with a card of what they were made from. Goes on where an earlier run
into the same folder was interrupted. On a GPU where there is one."""
_MORE = """examples:
  groundstation train-proposals --out out/proposals
  groundstation train-proposals --out out/proposals --clips aircraft-clips --workers 2
  groundstation train-proposals --out out/more --first-world 3000 --start out/proposals/proposals.onnx

writes proposals.onnx, card.json, log.csv, checkpoint.pt and pictures.npz.
Needs groundstation[train]. Two cores take about half a second a step of 64 crops.

exit code: 0 done; 1 bad input; 2 wrong usage; 130 interrupted: the same command goes on"""


def add_train_proposals(commands: Commands) -> None:
    """Add `train-proposals`."""
    train = add_command(
        commands,
        "train-proposals",
        run_train_proposals,
        "drawn pictures in, weights of the proposal network out",
        _TRAIN,
        _MORE,
    )
    add_result_folder(train, ("proposals.onnx", "card.json"))
    train.add_argument("--clips", type=READ, metavar="DIR", help="folder of labelled real clips, which are mixed in")
    train.add_argument("--start", type=READ, metavar="ONNX", help="weights to begin with")
    train.add_argument(
        "--first-world",
        type=whole_number,
        metavar="N",
        default=2000,
        help="number of the first train world (default: 2000)",
    )
    train.add_argument(
        "--worlds", type=count, metavar="N", default=700, help="how many train worlds are filmed (default: 700)"
    )
    train.add_argument("--views", type=count, metavar="N", default=6, help="pictures of each world (default: 6)")
    train.add_argument("--steps", type=count, metavar="N", default=8000, help="steps of training (default: 8000)")
    train.add_argument(
        "--rate", type=positive_number, metavar="R", default=3e-3, help="largest learning rate (default: 0.003)"
    )
    train.add_argument(
        "--batch", type=count, metavar="N", default=64, help="crops in each step, eight of a picture (default: 64)"
    )
    train.add_argument(
        "--workers", type=count, metavar="N", default=1, help="processes; the result is the same (default: 1)"
    )
    train.add_argument("--seed", type=count, metavar="N", default=1, help="seed of weights and crops (default: 1)")


def run_train_proposals(options: argparse.Namespace) -> int:
    """Train and say where the weights are; returns the exit code."""
    try:
        from training.proposal_fit import ProposalSettings
        from training.proposal_request import ProposalRequest, train_proposals
    except ModuleNotFoundError as fault:
        wanted = "pip install 'groundstation[train]'"
        raise InputError("train-proposals", got=str(fault), wanted=wanted) from fault
    from training.filmed_pictures import PictureRequest

    request = ProposalRequest(
        out=options.out,
        pictures=PictureRequest(worlds=options.worlds, first=options.first_world, pictures=options.views),
        clips=options.clips,
        start=options.start,
        fit=ProposalSettings(seed=options.seed, steps=options.steps, batch=options.batch, rate=options.rate),
        workers=options.workers,
    )
    with ProgressLine(sys.stderr, "train", "step") as line:
        weights, card, sha256 = train_proposals(request, lambda _, done, total: line.update(done, total))
    print(f"weights {sha256}")
    print_files((weights, card))
    return 0
