"""Imports go one way, the core reads no clock, file, socket or environment, and modules stay small."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("groundstation", "calibration", "ptu_drivers")

# From the top down: a module may import from its own layer and from those below it, never from above.
LAYERS: tuple[tuple[str, ...], ...] = (
    ("groundstation.cli", "groundstation.cli_start", "groundstation.__main__"),
    (
        "groundstation.cli_calibrate",
        "groundstation.cli_calibrate_landmarks",
        "groundstation.cli_calibrate_mount",
        "groundstation.cli_calibrate_timing",
        "groundstation.cli_cameras",
        "groundstation.cli_import",
        "groundstation.cli_live",
        "groundstation.cli_calibrate_runway",
        "groundstation.cli_onboard",
        "groundstation.cli_onboard_fly",
        "groundstation.cli_onboard_pose",
        "groundstation.cli_ptu",
        "groundstation.cli_recording",
        "groundstation.cli_reproduce",
        "groundstation.cli_simulate",
        "groundstation.cli_view",
        "groundstation.cli_evaluate",
    ),
    (
        "groundstation.cli_span",
        "groundstation.cli_paths",
        "groundstation.numbers_as_values",
        "groundstation.cli_ptu_open",
    ),
    ("calibration",),
    ("groundstation.view", "groundstation.compare"),
    ("groundstation.compared_runs",),
    ("groundstation.importing",),
    (
        *("groundstation.replay", "groundstation.track_video", "groundstation.plan", "groundstation.progress"),
        *("groundstation.convert", "groundstation.recover", "groundstation.filming"),
    ),
    ("groundstation.experiments",),
    ("groundstation.recorded_run",),
    ("groundstation.onboard_video", "groundstation.onboard_fly", "groundstation.onboard_render"),
    ("groundstation.onboard_fly_sinks", "groundstation.onboard_pose_sinks"),
    ("groundstation.onboard_sinks",),
    ("groundstation.run", "groundstation.planning", "groundstation.live", "groundstation.reference_knowledge"),
    ("groundstation.onboard",),
    ("groundstation.sources", "groundstation.sinks", "groundstation.simulation"),
    ("groundstation.session", "groundstation.evaluation", "groundstation.logs"),
    (
        "groundstation.pipeline",
        "groundstation.reference_update",
        "groundstation.frame_update",
        "groundstation.target_keeper",
        "groundstation.camera_tracker",
        "groundstation.station_health",
        "groundstation.pending_report",
    ),
    ("groundstation.config",),
    ("groundstation.epoch", "groundstation.track_life", "groundstation.flight_direction", "groundstation.warm_up"),
    (
        "groundstation.integrity",
        "groundstation.existence",
        "groundstation.search_region",
        "groundstation.search_pattern",
        "groundstation.pointing",
    ),
    ("groundstation.keep_out", "groundstation.keep_out_pilot", "groundstation.detour"),
    ("groundstation.sun",),
    ("groundstation.solution_separation", "groundstation.leave_one_out"),
    ("groundstation.detection", "groundstation.estimation", "groundstation.triangulation", "groundstation.synchronise"),
    ("groundstation.recording",),
    ("groundstation.rig_toml",),
    (
        *("groundstation.messages", "groundstation.detection_messages"),
        *("groundstation.rig", "groundstation.rig_covariance", "groundstation.rig_reference"),
    ),
    ("groundstation.ptu_axes",),
    ("groundstation.toml_table",),
    ("groundstation.text_file",),
    ("groundstation.geometry", "groundstation.picture"),
    (
        "groundstation.errors",
        "groundstation.arrays",
        "groundstation.count_words",
        "groundstation.hand_over",
        "groundstation.image_header",
        "groundstation.output_names",
        "groundstation.overwriting",
        "groundstation.png_file",
        "groundstation.result_files",
        "groundstation.seldom_said",
        "groundstation.spoken",
        "groundstation.stop_asked",
        "groundstation.__version__",
    ),
)
# tuning of a component is read by the layer that gathers all tuning, wherever the component lives
LEAVES = ("groundstation.evaluation.config",)
CORE = (
    "detection",
    "estimation",
    "geometry",
    "picture",
    "pipeline",
    "frame_update",
    "synchronise",
    "triangulation",
    "epoch",
    "track_life",
    "target_keeper",
    "camera_tracker",
    "flight_direction",
    "station_health",
    "pending_report",
    "integrity",
    "solution_separation",
    "existence",
    "pointing",
    "keep_out",
    "detour",
    "sun",
    "search_pattern",
    "search_region",
    "simulation",
)
EDGE_LIBRARIES = {"serial", "rerun", "matplotlib"}
CLOCKS_AND_FILES = {"time", "datetime", "os", "io", "socket", "subprocess", "tempfile", "shutil", "urllib", "threading"}


def modules() -> dict[str, Path]:
    found = {}
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
            found[name.removesuffix(".__init__")] = path
    return found


def imports_of(path: Path) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module)
            names.update(f"{node.module}.{alias.name}" for alias in node.names)
    return names


def layer_of(name: str) -> int | None:
    for depth, layer in enumerate(LAYERS):
        if any(name == entry or name.startswith(entry + ".") for entry in layer):
            return depth
    return None


def test_every_module_has_a_layer() -> None:
    missing = [n for n in modules() if n.startswith("groundstation.") and layer_of(n) is None]
    assert not missing, f"give these modules a place in LAYERS: {missing}"


def test_imports_go_down_only() -> None:
    wrong = []
    for name, path in modules().items():
        own = layer_of(name)
        if own is None:
            continue
        for imported in imports_of(path):
            other = layer_of(imported)
            if other is not None and other < own and imported not in LEAVES and not imported.startswith(LEAVES):
                wrong.append(f"{name} imports {imported}")
    assert not wrong, "\n".join(wrong)


def test_ptu_drivers_stand_alone() -> None:
    for name, path in modules().items():
        if name.startswith("ptu_drivers"):
            assert not [i for i in imports_of(path) if i.startswith(("groundstation", "calibration"))], name


def test_the_ground_chain_does_not_know_the_onboard_systems() -> None:
    for name, path in modules().items():
        if not name.startswith(("groundstation.onboard", "groundstation.experiments", "groundstation.cli")):
            assert not [i for i in imports_of(path) if i.startswith("groundstation.onboard")], name


def test_the_ground_chain_does_not_know_the_calibration() -> None:
    for name, path in modules().items():
        if name.startswith("groundstation.") and not name.startswith("groundstation.cli"):
            assert not [i for i in imports_of(path) if i.split(".")[0] == "calibration"], name


@pytest.mark.parametrize("part", CORE)
def test_the_core_reads_no_clock_and_no_file(part: str) -> None:
    for name, path in modules().items():
        if not name.startswith(f"groundstation.{part}"):
            continue
        tops = {i.split(".")[0] for i in imports_of(path)}
        assert not tops & CLOCKS_AND_FILES, f"{name} imports {tops & CLOCKS_AND_FILES}"
        assert not tops & EDGE_LIBRARIES, f"{name} imports {tops & EDGE_LIBRARIES}"
        calls = {
            n.func.id
            for n in ast.walk(ast.parse(path.read_text()))
            if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)
        }
        assert not calls & {"open", "print", "input"}, f"{name} calls {calls & {'open', 'print', 'input'}}"


def test_modules_have_names_that_say_something() -> None:
    vague = {"utils", "util", "helpers", "helper", "common", "misc", "tools"}
    assert not [n for n in modules() if n.rsplit(".", 1)[-1] in vague]


def test_modules_stay_readable() -> None:
    long = {n: k for n, p in modules().items() if (k := len(p.read_text().splitlines())) > 360}
    assert not long, f"too long to find one's way in: {long}"
