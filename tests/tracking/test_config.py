import dataclasses
import tomllib
from enum import StrEnum
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from groundstation.errors import ConfigError
from groundstation.tracking.config import (
    Config,
    TrackStart,
    config_from_mapping,
    config_to_mapping,
    config_to_toml,
    load_config,
)
from tests.complaints import complaint, only
from tests.mutation import damaged, toml_values

DEFAULTS = config_to_toml(config_to_mapping(Config()))


def load(folder: Path, text: str | bytes) -> Config:
    path = folder / "tuning.toml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return load_config(path)


def test_no_file_and_an_empty_file_give_the_defaults(tmp_path: Path) -> None:
    assert load_config(None) == Config() == load(tmp_path, "")


def test_what_a_file_leaves_out_keeps_its_default(tmp_path: Path) -> None:
    config = load(tmp_path, 'start = "dgps"\n[detection]\nroi_basic_px = [300, 120]\n[detection.level_set]\nmu = 1\n')
    assert config.start is TrackStart.DGPS
    assert config.detection.roi_basic_px == (300, 120)
    assert config.detection.level_set.mu == 1.0
    assert isinstance(config.detection.level_set.mu, float)
    assert config.estimation == Config().estimation


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("strat = 1", "tuning.toml: strat: got an unknown key; wanted one of acquisition, detection"),
        ("[detection]\nmu = 1", "tuning.toml: detection: mu: got an unknown key; wanted one of ambiguity_ratio"),
        ('start = "now"', "start: got 'now'; wanted one of 'auto', 'search', 'initial', 'dgps'"),
        ("start = 1", "start: got 1; wanted one of"),
        ("detection = 1", "detection: got 1; wanted a table"),
        ('[detection]\ngate_sigmas = "5"', "gate_sigmas: got '5'; wanted a finite number"),
        ("[detection]\ngate_sigmas = nan", "gate_sigmas: got nan; wanted a finite number"),
        ("[detection]\ngate_sigmas = 0x" + "f" * 300, "tuning.toml: got not TOML (an integer of 1200 bits)"),
        ("[detection]\nequalise = 1", "equalise: got 1; wanted true or false"),
        ("[detection]\nroi_basic_px = [250]", "roi_basic_px: got [250]; wanted a list of a whole number and a whole"),
        ("[detection]\nroi_basic_px = [250, 99.5]", "roi_basic_px: got 99.5; wanted a whole number"),
        (
            "[detection]\nroi_basic_px = [0, 100]",
            "tuning.toml: detection: got roi_basic_px = [0, 100]; wanted a value inside its bounds: "
            "roi_basic_px must be ≥ 1",
        ),
        (
            "[initiation]\nmax_speed_m_s = 2.0\nmin_speed_m_s = 3.0",
            "initiation: got min_speed_m_s = 3.0, max_speed_m_s = 2.0; wanted a value inside its bounds: min_speed_m_s "
            "must be ≥ 0 and below max_speed_m_s",
        ),
        (
            "[evaluation]\nlag_window_s = -1",
            "evaluation: got lag_window_s = -1.0; wanted a value inside its bounds: max",
        ),
        ("[estimation]\ngate_probability = 1.5", "estimation: got gate_probability 1.5 outside 0 … 1"),
        ("[detection.level_set]\niterations = true", "iterations: got True; wanted a whole number"),
        ("a = [", "got not TOML"),
    ],
)
def test_a_fault_names_the_key(tmp_path: Path, text: str, message: str) -> None:
    assert message in complaint(ConfigError, lambda: load(tmp_path, text))


def test_the_defaults_as_toml_are_the_defaults(tmp_path: Path) -> None:
    assert load(tmp_path, DEFAULTS) == Config()


def values_of(hint: Any) -> st.SearchStrategy[Any]:
    """Values that a field of this type takes, as TOML has them; numbers small enough for every bound's sake."""
    if get_origin(hint) in (Union, UnionType):
        return st.one_of([values_of(o) for o in get_args(hint) if o is not NoneType])
    if get_origin(hint) is tuple:
        parts = get_args(hint)
        if parts[-1] is Ellipsis:
            return st.lists(values_of(parts[0]), min_size=1, max_size=4)
        return st.tuples(*map(values_of, parts)).map(list)
    if dataclasses.is_dataclass(hint):
        return tables_of(hint)
    if issubclass(hint, StrEnum):
        return st.sampled_from([m.value for m in hint])
    return {float: st.floats(0.01, 0.99), int: st.integers(1, 500), bool: st.booleans()}.get(hint, st.text(max_size=5))


def tables_of(kind: Any) -> st.SearchStrategy[dict[str, Any]]:
    hints = get_type_hints(kind)
    return st.fixed_dictionaries({}, optional={f.name: values_of(hints[f.name]) for f in dataclasses.fields(kind)})


@settings(max_examples=60)
@given(tables_of(Config))
def test_what_was_read_and_written_reads_the_same(values: dict[str, Any]) -> None:
    with only(ConfigError) as reported:
        config = config_from_mapping(Config, values, "tuning")
        again = config_from_mapping(Config, tomllib.loads(config_to_toml(config_to_mapping(config))), "tuning")
        assert again == config
    # some fields have bounds of their own, or between each other
    assert all("a value inside its bounds" in message for message in reported)


@settings(max_examples=60)
@given(st.dictionaries(st.sampled_from([f.name for f in dataclasses.fields(Config)] + ["other"]), toml_values()))
def test_arbitrary_values_raise_only_project_errors(values: dict[str, Any]) -> None:
    with only(ConfigError):
        config_from_mapping(Config, values, "tuning")


@settings(max_examples=60)
@given(st.one_of(st.binary(max_size=60), damaged(DEFAULTS)))
def test_arbitrary_bytes_raise_only_project_errors(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    with only(ConfigError):
        load(tmp_path_factory.getbasetemp(), content)


@pytest.mark.parametrize(
    ("table", "key", "value"),
    [
        ("initiation", "max_speed_m_s", "1e308"),
        ("initiation", "size_tolerance", "0.0"),
        ("estimation", "lost_after_s", "-8.0"),
        ("estimation", "labelled_sigma_px", "-1.0"),
        ("estimation", "gate_probability", "1.5"),
        ("estimation", "acceleration_psd_m2_s3", "[0.5, -2.0, 0.5]"),
        ("synchronise", "hold_s", "-1.0"),
    ],
)
def test_tuning_outside_its_bounds_is_refused(tmp_path: Path, table: str, key: str, value: str) -> None:
    path = tmp_path / "tuning.toml"
    path.write_text(f"[{table}]\n{key} = {value}\n")
    with pytest.raises(ConfigError, match=key):
        load_config(path)
