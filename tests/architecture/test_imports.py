"""Imports go one way, the core reads no clock, file, socket or environment, and modules stay small."""

import ast

import pytest

from tests.architecture.sources import ROOT, imports_of, modules, nodes_of, text_of, tree_of

# From the top down: a folder may import from those below its own layer, never from its own layer or above.
LAYERS: tuple[tuple[str, ...], ...] = (
    ("groundstation.__main__",),
    ("groundstation.cli",),
    ("training",),
    ("groundstation.api", "groundstation.bank", "groundstation.experiments"),
    ("groundstation.onboard",),
    ("groundstation.simulation",),
    ("groundstation.live",),
    ("groundstation.replay", "groundstation.single_camera"),
    ("calibration", "groundstation.approach", "groundstation.conversion", "groundstation.viewer"),
    (
        "groundstation.autopilot",
        "groundstation.landing",
        "groundstation.planning",
        "groundstation.sinks",
        "groundstation.sources",
        "groundstation.tracking",
    ),
    ("groundstation.evaluation", "groundstation.integrity", "groundstation.session"),
    ("groundstation.detection", "groundstation.estimation", "groundstation.pointing", "groundstation.recording"),
    ("groundstation.registration",),
    ("groundstation.messages", "groundstation.rig", "groundstation.landing_site"),
    ("groundstation.detection_messages", "groundstation.picture", "groundstation.files", "groundstation.geometry"),
    (
        "groundstation.errors",
        "groundstation.arrays",
        "groundstation.box",
        "groundstation.compilation",
        "groundstation.thread_scheduling",
        "ptu_drivers",
    ),
)
MOST_FLAT = 10
# read no clock, no file, no socket and no environment
CORE = (
    "detection",
    "estimation",
    "geometry",
    "integrity",
    "landing",
    "picture",
    "pointing",
    "registration",
    "simulation",
    "tracking",
)
# of the simulation, what runs in real time, in processes, or writes folders
SIMULATION_EDGE = (
    "attached_simulator",
    "device_simulator",
    "render_flight",
    "rendered_session_folder",
    "session_folder",
    "silhouette_archive",
    "simulated_receiver",
    "simulated_station",
    "simulated_station_file",
)
EDGE_LIBRARIES = {"serial", "rerun", "matplotlib"}
CLOCKS_AND_FILES = {"time", "datetime", "os", "io", "socket", "subprocess", "tempfile", "shutil", "urllib", "threading"}


def folder_of(name: str) -> str | None:
    """Return the entry of LAYERS that a module belongs to."""
    entries = [entry for layer in LAYERS for entry in layer]
    return next((e for e in entries if name == e or name.startswith(e + ".")), None)


def folder_imports() -> dict[tuple[str, str], list[str]]:
    """Return which folders import which others, with the modules that do."""
    found: dict[tuple[str, str], list[str]] = {}
    known = modules()
    for name, path in known.items():
        own = folder_of(name)
        for imported in imports_of(path) & known.keys():
            other = folder_of(imported)
            if own and other and own != other:
                found.setdefault((own, other), []).append(f"{name} imports {imported}")
    return found


def test_every_module_has_a_layer() -> None:
    missing = [n for n in modules() if n.startswith("groundstation.") and folder_of(n) is None]
    assert not missing, f"give these modules a place in LAYERS: {missing}"


def test_few_modules_lie_outside_of_a_folder() -> None:
    flat = [n for n, path in modules().items() if path.parent == ROOT / "groundstation"]
    assert len(flat) <= MOST_FLAT, f"put these into folders: {flat}"


def test_imports_go_down_only() -> None:
    depth = {entry: k for k, layer in enumerate(LAYERS) for entry in layer}
    wrong = [line for (own, other), lines in folder_imports().items() if depth[other] <= depth[own] for line in lines]
    assert not wrong, "\n".join(wrong)


def test_no_two_folders_import_each_other() -> None:
    pairs = folder_imports()
    wrong = [pairs[own, other] for own, other in pairs if own < other and (other, own) in pairs]
    assert not wrong, wrong


def test_ptu_drivers_import_nothing_of_the_project() -> None:
    for name, path in modules().items():
        if name.startswith("ptu_drivers"):
            assert not [i for i in imports_of(path) if i.startswith(("groundstation", "calibration"))], name


def test_the_ground_chain_does_not_import_the_onboard_systems() -> None:
    for name, path in modules().items():
        if not name.startswith(("groundstation.onboard", "groundstation.experiments", "groundstation.cli.")):
            assert not [i for i in imports_of(path) if i.startswith("groundstation.onboard")], name


def test_the_ground_chain_does_not_import_the_calibration() -> None:
    for name, path in modules().items():
        if name.startswith("groundstation.") and not name.startswith("groundstation.cli."):
            assert not [i for i in imports_of(path) if i.split(".")[0] == "calibration"], name


@pytest.mark.parametrize("part", CORE)
def test_the_core_reads_no_clock_and_no_file(part: str) -> None:
    edge = {f"groundstation.simulation.{name}" for name in SIMULATION_EDGE}
    checked = {n: p for n, p in modules().items() if folder_of(n) == f"groundstation.{part}" and n not in edge}
    assert checked
    for name, path in checked.items():
        tops = {i.split(".")[0] for i in imports_of(path)}
        assert not tops & CLOCKS_AND_FILES, f"{name} imports {tops & CLOCKS_AND_FILES}"
        assert not tops & EDGE_LIBRARIES, f"{name} imports {tops & EDGE_LIBRARIES}"
        if not any(name in text_of(path) for name in ("open", "print", "input")):
            continue
        calls = {n.func.id for n in nodes_of(path) if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)}
        assert not calls & {"open", "print", "input"}, f"{name} calls {calls & {'open', 'print', 'input'}}"


def test_module_names_are_descriptive() -> None:
    vague = {"utils", "util", "helpers", "helper", "common", "misc", "tools"}
    assert not [n for n in modules() if n.rsplit(".", 1)[-1] in vague]


def test_modules_stay_readable() -> None:
    long = {n: k for n, p in modules().items() if (k := len(text_of(p).splitlines())) > 360}
    assert not long, f"too long to find one's way in: {long}"


def test_no_two_classes_have_one_name() -> None:
    """Expected: a class is named after what it alone is, so that it is found by its name."""
    found: dict[str, list[str]] = {}
    for name, path in modules().items():
        for node in tree_of(path).body:
            if isinstance(node, ast.ClassDef):
                found.setdefault(node.name, []).append(name)
    assert not {n: places for n, places in found.items() if len(places) > 1}


def test_benchmarks_that_use_the_tests_find_them_when_they_are_run_as_scripts() -> None:
    """A script has its own folder on the path, not the repository: one ended with "No module named 'tests'"."""
    scripts = [path for path in sorted((ROOT / "benchmarks").glob("*.py")) if "\nfrom tests" in text_of(path)]
    assert scripts
    assert not [path.name for path in scripts if "sys.path.insert(" not in text_of(path).split("\nfrom tests")[0]]
