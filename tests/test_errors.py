"""Errors go from one process to another as they are."""

import importlib
import pickle
import pkgutil

import groundstation
from groundstation.errors import InputError, SessionError


def all_kinds(kind: type[InputError]) -> list[type[InputError]]:
    return [kind, *(each for child in kind.__subclasses__() for each in all_kinds(child))]


def test_an_input_error_of_every_kind_is_the_same_after_pickling() -> None:
    for module in pkgutil.walk_packages(groundstation.__path__, "groundstation."):
        if module.name.endswith("errors") or ".simulation" in module.name:
            importlib.import_module(module.name)
    kinds = all_kinds(InputError)
    assert SessionError in kinds
    for kind in kinds:
        if kind.__init__ is not InputError.__init__:
            continue
        fault = kind("rig.toml: focal_px", got="−3", wanted="above 0")
        again = pickle.loads(pickle.dumps(fault))
        assert type(again) is kind
        assert (str(again), again.where, again.got, again.wanted) == (str(fault), fault.where, fault.got, fault.wanted)
