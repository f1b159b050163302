"""Words that have a plainer technical term are used neither in code nor in tests nor on the pages."""

import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
WORDS = re.compile(r"\b(anew|beside|whoever|nobody)\b", re.IGNORECASE)
# kinds of events in recordings, which stay as they are
FILE_KEYS = re.compile(r"[`\"]begun anew[`\"]")
SUFFIXES = {".py", ".md", ".toml", ".yml", ".yaml", ".cfg", ".html", ".css", ".js", ".json"}
# the key of a configuration file, which stays as it is
CONFIG_KEY = re.compile(r"(config\.|^ +)beside\b( : |: int|\))")


def tracked() -> list[str]:
    """Return the text files of the repository, without this one."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=False)
    if listed.returncode != 0:
        pytest.skip("not a git checkout")
    own = Path(__file__).relative_to(ROOT).as_posix()
    names = [n for n in listed.stdout.split("\0") if Path(n).suffix in SUFFIXES or Path(n).name == "Makefile"]
    return [n for n in names if n != own and (ROOT / n).is_file()]


def uses(name: str) -> list[str]:
    """Return the lines of a file that use one of the words, as ``path:number: word``."""
    text = (ROOT / name).read_text(encoding="utf-8", errors="replace")
    if not WORDS.search(text):
        return []
    lines = enumerate(text.splitlines(), start=1)
    return [
        f"{name}:{n}: {m.group()}"
        for n, line in lines
        for m in WORDS.finditer(CONFIG_KEY.sub("", FILE_KEYS.sub("", line)))
    ]


def test_plain_words_are_used_in_code_tests_and_pages() -> None:
    found = [use for name in tracked() for use in uses(name)]
    assert not found
