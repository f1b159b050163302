"""Rendered worlds are kept: used again for the same world and renderer, and for no other."""

from dataclasses import replace
from pathlib import Path

import pytest

from groundstation.bank import rendered_worlds
from groundstation.errors import InputError
from groundstation.simulation.world.draw_world import draw_world
from groundstation.simulation.world.world import World


class _Renderer:
    """Stands for `render_world`: counts what it renders."""

    def __init__(self) -> None:
        self.rendered: list[int] = []

    def __call__(self, world: World, folder: Path) -> None:
        self.rendered.append(world.seed)
        folder.mkdir(parents=True)
        (folder / "session.toml").write_text(f"seed = {world.seed}\n")


@pytest.fixture
def renderer(monkeypatch: pytest.MonkeyPatch) -> _Renderer:
    stand_in = _Renderer()
    monkeypatch.setattr(rendered_worlds, "render_world", stand_in)
    return stand_in


def test_a_world_is_rendered_once(renderer: _Renderer, tmp_path: Path) -> None:
    world = draw_world(5)
    first = rendered_worlds.rendered_world(world, tmp_path / "worlds")
    assert rendered_worlds.rendered_world(world, tmp_path / "worlds") == first
    assert renderer.rendered == [5]
    assert (first / "session.toml").read_text() == "seed = 5\n"


def test_another_world_rate_or_duration_has_its_own_folder(renderer: _Renderer, tmp_path: Path) -> None:
    world = draw_world(5)
    others = [draw_world(6), replace(world, frame_hz=20.0), draw_world(5, duration_s=12.0)]
    folders = {rendered_worlds.rendered_world(one, tmp_path) for one in (world, *others)}
    assert len(folders) == 4
    assert renderer.rendered == [5, 6, 5, 5]


def test_another_renderer_renders_again(renderer: _Renderer, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    world = draw_world(5)
    first = rendered_worlds.rendered_world(world, tmp_path)
    monkeypatch.setattr(rendered_worlds, "_renderer_digest", lambda: "another")
    assert rendered_worlds.rendered_world(world, tmp_path) != first
    assert renderer.rendered == [5, 5]
    assert first.is_dir()


def test_two_processes_at_the_same_world(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    render = _Renderer()

    def beaten(world: World, folder: Path) -> None:
        render(world, folder)
        if len(render.rendered) == 1:
            # the other one is faster
            rendered_worlds.rendered_world(world, tmp_path)

    monkeypatch.setattr(rendered_worlds, "render_world", beaten)
    session = rendered_worlds.rendered_world(draw_world(5), tmp_path)
    assert render.rendered == [5, 5]
    assert list(tmp_path.iterdir()) == [session]
    assert (session / "session.toml").is_file()


def test_an_empty_folder_is_no_rendered_world(renderer: _Renderer, tmp_path: Path) -> None:
    session = rendered_worlds.rendered_world(draw_world(5), tmp_path)
    (session / "session.toml").unlink()
    assert (rendered_worlds.rendered_world(draw_world(5), tmp_path) / "session.toml").is_file()


@pytest.mark.parametrize("package", ["geometry/camera.py", "rig/rig.py", "picture.py", "simulation/simulate.py"])
def test_all_that_decides_on_a_picture_is_in_the_name(package: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: a projection or a rolling shutter that changes makes old pictures wrong."""
    before = rendered_worlds._renderer_digest.__wrapped__()
    own = Path.read_bytes

    def changed(path: Path) -> bytes:
        return own(path) + (b"#" if path.as_posix().endswith(f"groundstation/{package}") else b"")

    monkeypatch.setattr(Path, "read_bytes", changed)
    assert rendered_worlds._renderer_digest.__wrapped__() != before


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "worlds").write_text("")
    with pytest.raises(InputError, match="worlds"):
        rendered_worlds.rendered_world(draw_world(5), tmp_path / "worlds")
