"""`.ci/run` insists on the programs of others, patiently; with programs of the same names that only take notes."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
ALL = "mrpt chromium aravis flirptu alpaca-simulators evo node-mavlink pyptzcontroller dynamixel-sdk mavsdk"
# fails as often as the file of its name and subcommand states, and records its arguments, and the tests' environment
NOTE = """#!/bin/sh
echo "$(basename "$0") $*" >>"$NOTES/log"
[ "$(basename "$0") $1" = "make test" ] && echo "peers:$GROUNDSTATION_REQUIRED_PEERS" >>"$NOTES/log"
left="$NOTES/$(basename "$0")-$1"
[ -s "$left" ] || exit 0
sed -i '$d' "$left"
exit 1
"""


class Machine:
    """A machine whose registries fail so many times."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        (folder / ".ci").mkdir()
        (folder / "bin").mkdir()
        shutil.copy(ROOT / ".ci" / "run", folder / ".ci" / "run")
        for name in ("apt-get", "apt-cache", "make", "sleep", "node", "npm"):
            self.program(name, NOTE)
        self.program("id", "#!/bin/sh\necho 0\n")

    def program(self, name: str, text: str) -> None:
        path = self.folder / "bin" / name
        path.write_text(text)
        path.chmod(0o755)

    def fails(self, command: str, times: int) -> None:
        (self.folder / command.replace(" ", "-")).write_text("x\n" * times)

    def run(self, ci: str = "true") -> tuple[int, list[str], str]:
        """Return exit code, calls, and output."""
        env = {**os.environ, "PATH": f"{self.folder / 'bin'}:{os.environ['PATH']}", "NOTES": str(self.folder), "CI": ci}
        env.pop("GROUNDSTATION_REQUIRED_PEERS", None)
        done = subprocess.run([self.folder / ".ci" / "run"], env=env, capture_output=True, text=True, check=False)
        log = self.folder / "log"
        return done.returncode, log.read_text().splitlines() if log.exists() else [], done.stderr


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    return Machine(tmp_path)


def test_all_that_was_installed_is_required_of_the_tests(machine: Machine) -> None:
    code, called, _ = machine.run()
    assert code == 0
    assert called[-1].split() == ["peers:" + ALL.split()[0], *ALL.split()[1:]]
    assert called[0].startswith("apt-get install -y --no-install-recommends libmrpt-hwdrivers-dev")
    assert called[1] == "apt-get install -y --no-install-recommends chromium"
    assert called[2] == "apt-get install -y --no-install-recommends aravis-tools iproute2"


def test_a_registry_that_is_briefly_away(machine: Machine) -> None:
    machine.fails("apt-get install", 2)
    machine.fails("make peers", 3)
    code, called, reported = machine.run()
    assert code == 0
    assert called.count("make peers") == 4
    assert [c for c in called if c.startswith("sleep")] == ["sleep 5", "sleep 5", "sleep 20", "sleep 60"]
    assert called[-1].split()[1:] == ALL.split()[1:]
    assert "ci: failed: make peers; again in 5 s" in reported


@pytest.mark.parametrize("command", ["apt-get install", "make peers"])
def test_a_registry_that_stays_away_fails_the_run(machine: Machine, command: str) -> None:
    machine.fails(command, 99)
    code, called, reported = machine.run()
    assert code == 1
    assert "make test" not in called
    assert "could not be installed in four tries, and CI=true insists on it: is the registry away?" in reported


def test_what_cannot_be_installed_here_is_not_required(machine: Machine) -> None:
    machine.fails("apt-get install", 1)
    machine.fails("apt-cache show", 1)
    code, called, reported = machine.run()
    assert code == 0
    assert called[-1].split() == ["peers:" + ALL.split()[1], *ALL.split()[2:]]
    assert "this system has no package of it" in reported
    machine.program("id", "#!/bin/sh\necho 1000\n")
    (machine.folder / "log").unlink()
    code, called, reported = machine.run()
    assert code == 0
    assert not any(c.startswith("apt") for c in called)
    assert "no apt-get here, or not root" in reported


def test_a_developer_gets_a_message_and_continues(machine: Machine) -> None:
    machine.fails("apt-get install", 99)
    machine.fails("make peers", 99)
    code, called, reported = machine.run(ci="")
    assert code == 0
    assert called[-2:] == ["make test", "peers:"]
    assert not any(c.startswith("sleep") for c in called)
    assert reported.count("could not be installed; the tests that need it will say so") == 4


def test_a_required_peer_that_is_absent_fails_its_test(monkeypatch: pytest.MonkeyPatch) -> None:
    from tests.peers import absent, peer_module

    monkeypatch.setenv("GROUNDSTATION_REQUIRED_PEERS", "mrpt evo")
    with pytest.raises(pytest.fail.Exception, match="mrpt is not here: apt install it"):
        absent("mrpt", "apt install it")
    with pytest.raises(pytest.skip.Exception, match="flirptu is not here"):
        absent("flirptu", "make peers")
    with pytest.raises(pytest.skip.Exception):
        peer_module("another", "no_such_module")
    assert peer_module("pytest", "pytest") is pytest
