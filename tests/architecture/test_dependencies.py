"""What the code imports is declared, what is declared is pinned, and the README's commands install what is pinned."""

import ast
import importlib.metadata
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

from tests.architecture.sources import ROOT, tree_of

OURS = {"groundstation", "calibration", "ptu_drivers", "training", "tests", "benchmarks"} | {
    p.stem for p in (ROOT / "benchmarks").iterdir()
}
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
EXTRAS: dict[str, list[str]] = PROJECT["optional-dependencies"]
# packages of the Makefile's targets `installed` and `cameras`
TESTED_EXTRAS = ("dev", "docs", "logs", "genicam", "gige")
# imported in an environment of its own that `make peers` builds, or that the study builds for itself
OF_OTHER_ENVIRONMENTS = {"flirptu", "stonesoup"}


def distributions(requirements: Iterable[str]) -> set[str]:
    """Return the canonical names of what is required."""
    return {canonicalize_name(Requirement(r).name) for r in requirements}


def imports(path: Path) -> Iterator[tuple[str, bool]]:
    """Yield each imported third-party top-level package, and whether importing the module imports it."""
    for node, on_import in import_statements(tree_of(path)):
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else [node.module or ""]
        for name in names:
            top = name.partition(".")[0]
            if top not in sys.stdlib_module_names and top not in OURS:
                yield top, on_import


def import_statements(scope: ast.AST, on_import: bool = True) -> Iterator[tuple[ast.Import | ast.ImportFrom, bool]]:
    """Yield absolute imports below a node, and whether they are on import: in no function, and not for types alone."""
    for node in ast.iter_child_nodes(scope):
        if isinstance(node, ast.Import) or (isinstance(node, ast.ImportFrom) and node.level == 0):
            yield node, on_import
        elif isinstance(node, ast.stmt | ast.ExceptHandler | ast.match_case):
            # nothing else has a statement in it
            deferred = isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) or is_for_types(node)
            yield from import_statements(node, on_import and not deferred)


def is_for_types(node: ast.AST) -> bool:
    return (
        isinstance(node, ast.If)
        and isinstance(node.test, ast.Name | ast.Attribute)
        and ast.unparse(node.test).endswith("TYPE_CHECKING")
    )


@cache
def of_package() -> Mapping[str, list[str]]:
    """Return the distributions that provide each package; reading all their file lists takes seconds."""
    return importlib.metadata.packages_distributions()


def undeclared(folders: Iterable[str], always: set[str], sometimes: set[str]) -> list[str]:
    """Return each import of a distribution that is in neither set; one on import has to be in ``always``."""
    found = []
    for folder in folders:
        for path in sorted((ROOT / folder).rglob("*.py")):
            for package, on_import in imports(path):
                # the package itself where no distribution of it is installed
                brought_by = {canonicalize_name(d) for d in of_package().get(package, (package,))}
                if not brought_by & (always if on_import else always | sometimes):
                    found.append(f"{path.relative_to(ROOT)}: {package} ({', '.join(sorted(brought_by))})")
    return found


def constraints() -> dict[str, Version]:
    """Return the pinned version of each distribution."""
    lines = [s for s in (ROOT / "constraints.txt").read_text().splitlines() if s and not s.startswith("#")]
    pins = {}
    for line in lines:
        match = re.fullmatch(r"([A-Za-z0-9._-]+)==([^\s;@]+)", line)
        assert match, f"constraints.txt: {line}"
        pins[canonicalize_name(match[1])] = Version(match[2])
    assert len(pins) == len(lines)
    return pins


def test_what_the_program_imports_is_declared() -> None:
    plain = distributions(PROJECT["dependencies"])
    extras = distributions(r for name, extra in EXTRAS.items() if name not in ("dev", "docs") for r in extra)
    ours = ("groundstation", "calibration", "ptu_drivers")
    assert undeclared(ours, plain, extras) == []
    # imported by the command that needs the extra, and by nothing else
    assert undeclared(("training",), plain | distributions(EXTRAS["train"]), extras) == []


def test_what_tests_and_benchmarks_import_is_declared() -> None:
    known = distributions([*PROJECT["dependencies"], *(r for extra in EXTRAS.values() for r in extra)])
    found = undeclared(("tests", "benchmarks", "docs"), known, known)
    assert [f for f in found if f.split()[1] not in OF_OTHER_ENVIRONMENTS] == []


def test_serial_units_and_the_comparison_need_no_extra() -> None:
    assert {"pyserial", "scikit-image", "pyarrow"} <= distributions(PROJECT["dependencies"])


def test_every_requirement_admits_the_tested_version_and_excludes_older_ones() -> None:
    pins = constraints()
    required = [*PROJECT["dependencies"], *(r for name in TESTED_EXTRAS for r in EXTRAS[name])]
    for requirement in map(Requirement, required):
        assert requirement.specifier.contains(pins[canonicalize_name(requirement.name)]), requirement
        assert any(s.operator == ">=" for s in requirement.specifier), requirement


@pytest.mark.parametrize("name", [Requirement(text).name for text in PROJECT["dependencies"]])
def test_a_major_release_that_may_break_us_is_not_admitted(name: str) -> None:
    (found,) = [r for r in map(Requirement, PROJECT["dependencies"]) if r.name == name]
    bounds = [Version(s.version) for s in found.specifier if s.operator == "<"]
    assert bounds
    assert min(bounds) > constraints()[canonicalize_name(name)]


def needed(name: str, extras: tuple[str, ...], seen: set[tuple[str, str]]) -> None:
    """Add to ``seen`` what a distribution needs here, with those extras, and what that needs in turn."""
    for text in importlib.metadata.requires(name) or []:
        requirement = Requirement(text)
        for extra in ("", *extras):
            key = (canonicalize_name(requirement.name), extra)
            wanted = requirement.marker is None or requirement.marker.evaluate({"extra": extra})
            if wanted and key not in seen:
                seen.add(key)
                needed(requirement.name, tuple(requirement.extras), seen)


def test_all_requirements_are_pinned_to_the_versions_of_these_tests() -> None:
    pins = constraints()
    names: set[tuple[str, str]] = set()
    needed("groundstation", ("dev", "docs", "logs"), names)
    assert len(names) > 50
    wrong = []
    for name, _ in sorted(names):
        if name == "groundstation":
            continue
        here = Version(importlib.metadata.version(name))
        if pins.get(name) != here:
            wrong.append(f"{name}: constraints.txt has {pins.get(name)}, here is {here}")
    assert wrong == []


def test_the_readme_s_commands_install_the_pinned_versions(tmp_path: Path) -> None:
    """Expected: in a tree without an environment, each command installs once, and keeps to constraints.txt."""
    text = (ROOT / "README.md").read_text()
    block = text[text.index("## Two commands") :].split("```")[1]
    commands = [line.split("#")[0].split() for line in block.splitlines() if line.strip()]
    assert commands == [["make", "demo"], ["make", "test"]]
    assert (ROOT / "constraints.txt").exists()
    for command in (*commands, ["make", "cameras"]):
        # another name of the environment is an environment that is not there yet
        dry = [*command, "--dry-run", "--no-print-directory", f"VENV={tmp_path / 'none'}"]
        reported = subprocess.run(dry, cwd=ROOT, capture_output=True, text=True, check=True).stdout
        installs = [line for line in reported.splitlines() if "pip install" in line and "-m pip" in line]
        assert installs
        assert all("--constraint constraints.txt" in line for line in installs)
