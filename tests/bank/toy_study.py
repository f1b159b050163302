"""A study of cheap jobs: means of drawn numbers, by blocks of seeds; each block leaves a mark when it is computed."""

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from parallel_study import StudyRun, add_study_arguments, in_blocks


def drawn(job: tuple[str, int, list[int]]) -> list[float]:
    """Return a drawn number for each seed; is interrupted at the seed of the file `interrupt`, once."""
    marks, scale, seeds = Path(job[0]), *job[1:]
    interrupt = marks / "interrupt"
    if interrupt.exists() and int(interrupt.read_text()) in seeds:
        interrupt.unlink()
        raise KeyboardInterrupt
    with (marks / f"{seeds[0]}").open("a") as file:
        file.write("computed\n")
    return [scale * float(np.random.default_rng(seed).normal()) for seed in seeds]


def main(arguments: Sequence[str]) -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("marks", type=Path)
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--scale", type=int, default=1)
    add_study_arguments(parser, "toy")
    options = parser.parse_args(arguments)
    jobs = {
        f"block-{block[0]}": (str(options.marks), options.scale, block) for block in in_blocks(range(options.runs), 4)
    }
    values = [v for block in StudyRun.chosen("toy", options).values(drawn, jobs).values() for v in block]
    print(f"{len(values)} runs, mean {np.mean(values)!r}")


if __name__ == "__main__":
    import sys

    main(sys.argv[1:])
