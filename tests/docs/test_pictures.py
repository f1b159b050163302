"""Each picture of the documentation has what makes it, and is on a page."""

from pathlib import Path

import pytest
from pages import pictures
from pages.pictures import PICTURES, Picture, remade
from pages.workshop import Workshop

from tests.docs.pages import PAGES, ROOT, links

IMAGES = ROOT / "docs" / "images"


def test_each_picture_is_in_the_table_and_on_a_page() -> None:
    files = sorted(path.name for path in IMAGES.iterdir())
    assert sorted(picture.name for picture in PICTURES) == files
    shown = {(page.parent / link).resolve() for page in PAGES for link in links(page)}
    assert [name for name in files if IMAGES / name not in shown] == []
    assert all(callable(picture.maker) and callable(picture.missing) for picture in PICTURES)


def test_pictures_carry_no_time_stamp_and_no_path() -> None:
    for path in IMAGES.iterdir():
        data = path.read_bytes()
        assert b"tIME" not in data[:200]
        assert str(ROOT).encode() not in data
        assert b"/home/" not in data


def test_a_picture_takes_its_place_whole_or_is_named_with_the_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def draw(shop: Workshop, path: Path) -> None:
        path.write_bytes(b"drawn")

    def broken(shop: Workshop, path: Path) -> None:
        path.write_bytes(b"half")
        raise RuntimeError("no more")

    table = (
        Picture("drawn.png", draw),
        Picture("needs.png", draw, lambda: "Chromium is not here: apt install chromium"),
        Picture("slow.png", draw, at_rest=True),
    )
    monkeypatch.setattr(pictures, "PICTURES", table)
    images = tmp_path / "images"
    images.mkdir()
    for picture in table:
        (images / picture.name).write_bytes(b"old")
    shop = Workshop(tmp_path / "work", lambda folder, name: None)
    assert list(remade(shop, images)) == [
        "drawn.png: made",
        "needs.png: left as it is: Chromium is not here: apt install chromium",
        "slow.png: left as it is: plays in real time: make it on a machine at rest, --pictures slow.png",
    ]
    assert [(images / picture.name).read_bytes() for picture in table] == [b"drawn", b"old", b"old"]
    assert list(remade(shop, images, ["slow.png"])) == ["slow.png: made"]
    monkeypatch.setattr(pictures, "PICTURES", (Picture("drawn.png", broken),))
    with pytest.raises(RuntimeError, match="no more"):
        list(remade(shop, images))
    assert (images / "drawn.png").read_bytes() == b"drawn"
