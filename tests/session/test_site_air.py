"""The air at a site in session.toml: read for the refraction of stars, refused where it cannot be."""

from pathlib import Path

import pytest

from groundstation.errors import SessionError
from groundstation.session import load_session
from groundstation.session.site_air import SiteAir
from tests.session.folder import Tiny


def with_air(folder: Path, text: str) -> Path:
    session = Tiny(rows=3).write(folder)
    path = session / "session.toml"
    path.write_text(path.read_text() + f"\n[air]\n{text}\n")
    return session


def test_a_session_states_its_air_or_has_the_standard_atmosphere(tmp_path: Path) -> None:
    assert load_session(Tiny(rows=3).write(tmp_path / "plain")).air == SiteAir()
    stated = load_session(with_air(tmp_path / "stated", "pressure_hpa = 955.5\nair_c = -2.25"))
    assert stated.air == SiteAir(pressure_hpa=955.5, air_c=-2.25)
    assert stated.air.keys() == {"pressure_hpa": 955.5, "air_c": -2.25}
    assert load_session(with_air(tmp_path / "one", "air_c = 30")).air.keys() == {"air_c": 30.0}


@pytest.mark.parametrize("text", ["pressure_hpa = 95.5", "air_c = 280", "pressure = 955"])
def test_air_that_cannot_be_is_refused_with_its_key(tmp_path: Path, text: str) -> None:
    with pytest.raises(SessionError, match=rf"session\.toml: air: {text.split()[0]}: got "):
        load_session(with_air(tmp_path / "s", text))
