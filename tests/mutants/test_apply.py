"""Functions of the program are found, in which faults are put in."""

import gc

from mutants.apply import function_objects

from groundstation.box import expand


def test_what_the_collection_of_tests_has_frozen_is_found() -> None:
    """No fault could be tried: the tests' own collection freezes all objects, and frozen ones are not listed."""
    gc.freeze()
    function_objects.cache_clear()
    try:
        assert expand in function_objects()["groundstation.box", "expand"]
    finally:
        function_objects.cache_clear()
        gc.freeze()
