"""A file of a megabyte costs its reader at most 512 MB and 10 s, and ends in one line of error, or in none."""

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.hostile.bombs import BOMBS, Bomb
from tests.kept_memory import usual_environment

MOST_BYTES = 512 << 20
# of the processor, so that a busy machine breaks nothing
MOST_S = 10.0
ROOT = Path(__file__).resolve().parents[2]
Measure = Callable[[str, bytes], dict[str, Any]]
CASES = [
    pytest.param(reader, bomb, id=f"{reader}-{bomb.__name__.strip('<>')}-{number}")
    for reader, bombs in BOMBS.items()
    for number, bomb in enumerate(bombs)
]


@pytest.fixture(scope="module")
def measure(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Measure]:
    """Reads a file with one of the readers, in a process of its own."""
    folder = tmp_path_factory.mktemp("readers")
    with subprocess.Popen(
        [sys.executable, "-m", "tests.hostile.measured", str(folder)],
        cwd=ROOT,
        env=usual_environment(),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        paths = json.loads(process.stdout.readline())

        def measured(reader: str, content: bytes) -> dict[str, Any]:
            path = Path(paths[reader])
            whole = path.read_bytes() if path.exists() else None
            path.write_bytes(content)
            print(reader, file=process.stdin, flush=True)
            answer: dict[str, Any] = json.loads(process.stdout.readline())
            if whole is not None:
                path.write_bytes(whole)
            return answer

        yield measured
        process.stdin.close()


@pytest.mark.parametrize(("reader", "bomb"), CASES)
def test_a_small_file_costs_little(reader: str, bomb: Bomb, measure: Measure) -> None:
    content = bomb()
    assert len(content) <= 1_048_576
    answer = measure(reader, content)
    assert answer["ours"], answer
    assert answer["error"].isprintable()
    assert answer["bytes"] <= MOST_BYTES, answer
    assert answer["seconds"] <= MOST_S, answer
