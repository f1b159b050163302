"""The script for the shell, as bash uses it; the others' where they are installed."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from groundstation.cli.completion import SHELLS
from groundstation.cli.main import main

# what bash does for the word under the cursor, the last one
QUERY = """
source "$1"; shift
function=$(complete -p groundstation | sed 's/.*-F \\([^ ]*\\).*/\\1/')
COMP_WORDS=("$@") COMP_CWORD=$(($# - 1)) COMPREPLY=()
"$function" groundstation "${COMP_WORDS[COMP_CWORD]}" "${COMP_WORDS[COMP_CWORD - 1]}"
printf '%s\\n' "${COMPREPLY[@]}"
"""


@pytest.fixture(scope="module")
def script(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("completion") / "groundstation.bash"
    printed = subprocess.run(
        [sys.executable, "-m", "groundstation", "completion", "bash"], capture_output=True, text=True, check=True
    )
    path.write_text(printed.stdout)
    return path


@pytest.mark.parametrize(
    ("words", "completed"),
    [
        (("re",), {"replay", "recover", "reproduce"}),
        (("calibrate", "su"), {"survey"}),
        (("replay", "--conf"), {"--config"}),
        (("replay", "FOLDER/ses"), {"FOLDER/session"}),
        (("replay", "--config", "FOLDER/tun"), {"FOLDER/tuning.toml"}),
        (("completion", "z"), {"zsh"}),
    ],
)
def test_bash_completes(script: Path, tmp_path: Path, words: tuple[str, ...], completed: set[str]) -> None:
    (tmp_path / "session").mkdir()
    (tmp_path / "tuning.toml").touch()
    typed = [word.replace("FOLDER", str(tmp_path)) for word in words]
    found = subprocess.run(
        ["bash", "-c", QUERY, "bash", str(script), "groundstation", *typed], capture_output=True, text=True, check=True
    )
    assert set(found.stdout.split()) == {word.replace("FOLDER", str(tmp_path)) for word in completed}
    assert found.stderr == ""


@pytest.mark.parametrize("shell", SHELLS)
def test_each_shell_reads_its_script(shell: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", shell]) == 0
    path = tmp_path / "script"
    path.write_text(capsys.readouterr().out)
    assert "groundstation" in path.read_text()
    if shutil.which(shell) is None:
        return
    checked = subprocess.run([shell, "-n", str(path)], capture_output=True, text=True, check=False)
    assert (checked.returncode, checked.stderr) == (0, "")


def test_a_shell_that_is_none(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["completion", "bsh"])
    assert ended.value.code == 2
    assert "did you mean bash?" in capsys.readouterr().err
