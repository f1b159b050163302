"""Independent clients drive the simulated unit; and their recorded exchanges are replayed without them.

MRPT's driver is compiled C++ (Debian: libmrpt-hwdrivers-dev), flirptu is Python (`make peers` installs it in a venv of
its own). If they cannot be installed their tests are skipped, or fail (tests/peers.py). The transcripts in peers/ are
the exchanged bytes: run this file with --record to write them again.
"""

import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from ptu_drivers.simulated.flir import FlirModel
from ptu_drivers.simulated.flir_line import LineModel, SimulatedUnit
from ptu_drivers.simulated.line import VirtualLine
from ptu_drivers.simulated.server import SimulatedServer
from tests.peers import absent

PEERS = Path(__file__).parent / "peers"
ROOT = Path(__file__).resolve().parents[2]
MRPT = Path("/usr/include/mrpt/hwdrivers/include/mrpt/hwdrivers/CPtuDPerception.h")


@pytest.fixture(scope="module")
def mrpt_client(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    if not MRPT.is_file() or not shutil.which("cmake") or not shutil.which("g++"):
        absent("mrpt", "apt install libmrpt-hwdrivers-dev cmake g++")
    folder = tmp_path_factory.mktemp("mrpt")
    for command in (["cmake", "-S", str(PEERS), "-B", str(folder)], ["cmake", "--build", str(folder)]):
        subprocess.run(command, check=True, capture_output=True)
    return [str(folder / "mrpt_client")]


@pytest.fixture(scope="module")
def flirptu_client() -> list[str]:
    python = ROOT / ".venv-peers" / "bin" / "python"
    asked = [str(python), "-c", "import flirptu"]
    if not python.is_file() or subprocess.run(asked, capture_output=True, check=False).returncode:
        absent("flirptu", "make peers")
    return [str(python), str(PEERS / "flirptu_client.py")]


def drive(client: list[str], tmp_path: Path) -> tuple[str, VirtualLine]:
    """Let a client drive a unit as it leaves the factory; return what it printed, and the line."""
    unit = SimulatedUnit(FlirModel(), LineModel(), seed=1)
    line = VirtualLine(unit, start_s=time.monotonic())
    line.record = True
    with SimulatedServer(line, tmp_path / "unit"):
        command = [*client, str(tmp_path / "unit")]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
        time.sleep(0.2)
    assert done.returncode == 0, done.stderr
    return done.stdout, line


def test_mrpt_drives_the_simulated_unit(mrpt_client: list[str], tmp_path: Path) -> None:
    reported, _ = drive(mrpt_client, tmp_path)
    assert "moved 1 awaited 1 asked 1 at 0.1000 limit 1 3.0369 beyond 0" in reported


def test_flirptu_drives_the_simulated_unit(flirptu_client: list[str], tmp_path: Path) -> None:
    reported, _ = drive(flirptu_client, tmp_path)
    assert reported.splitlines() == [
        "echo True resolution 23.142857 23.142857",
        "limits -27067 27067 -4666 13999 speed 8000 8000",
        "pan True 300 0",
        "tilt True -50 (300, -50)",
        "both True (-20, 10) 500",
        "beyond False",
        "without echo -20",
    ]


def transcript(line: VirtualLine) -> str:
    """Return commands and answers, one to a line, without times."""
    sent, came = (b"".join(d for _, w, d in line.traffic if w == way).decode("latin-1") for way in "><")
    commands = [c for c in re.split(r"[ \r\n]+", sent) if c]
    answers = [a + "\r\n" for a in came.split("\r\n") if a]
    return "".join(f"> {c}\n< {a!r}\n" for c, a in zip(commands, answers, strict=True))


def fresh() -> VirtualLine:
    return VirtualLine(SimulatedUnit(FlirModel(), LineModel(), seed=1))


def answer_to(line: VirtualLine, command: str) -> str:
    """Send one command, and return the line that came."""
    line.put(command.encode("latin-1") + b" ", 9600)
    got = b""
    while not got.endswith(b"\r\n"):
        line.settle(0.01)
        got += line.take()
    return repr(got.decode("latin-1"))


@pytest.mark.parametrize("name", ["mrpt", "flirptu"])
def test_recorded_exchanges_of_other_programs_are_replayed(name: str) -> None:
    """The unit answers the recorded commands as it did when the client was content."""
    rows = (PEERS / f"{name}.txt").read_text(encoding="utf-8").splitlines()
    assert len(rows) > 15
    line = fresh()
    for command, answer in zip(rows[::2], rows[1::2], strict=True):
        assert answer == f"< {answer_to(line, command.removeprefix('> '))}", command


if __name__ == "__main__" and "--record" in sys.argv:
    import tempfile

    for name, command in (("mrpt", sys.argv[2]), ("flirptu", sys.argv[3])):
        client = [command] if name == "mrpt" else [command, str(PEERS / "flirptu_client.py")]
        with tempfile.TemporaryDirectory() as folder:
            reported, line = drive(client, Path(folder))
            print(reported)
            (PEERS / f"{name}.txt").write_text(transcript(line), encoding="utf-8")
