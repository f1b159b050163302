"""Messages of the drivers' errors, and their fields for programs."""

import math

import pytest

from ptu_drivers.errors import LimitError, LineError, NoAnswerError, ProtocolError, PtuError, RefusedError


def test_each_message_contains_the_got_and_wanted_values() -> None:
    gone = LineError("/dev/ttyS0", got="no such\ndevice", wanted="a serial line")
    assert (gone.url, gone.got, gone.wanted) == ("/dev/ttyS0", "no such\ndevice", "a serial line")
    silent = NoAnswerError("PP", waited_s=0.25, got="nothing")
    assert (silent.command, silent.waited_s) == ("PP", 0.25)
    assert str(silent) == "PP: got nothing in 0.25 s; wanted an answer"
    foreign = ProtocolError("PR", got="rubbish", wanted="a number")
    assert (foreign.where, foreign.got, foreign.wanted) == ("PR", "rubbish", "a number")
    refused = RefusedError("PS9", reported="Maximum speed exceeded")
    assert (refused.command, refused.reported) == ("PS9", "Maximum speed exceeded")
    for error in (gone, silent, foreign, refused):
        assert isinstance(error, PtuError)
        assert len(str(error).splitlines()) == 1


def test_a_limit_is_stated_in_degrees_and_kept_in_radians() -> None:
    error = LimitError("tilt", "upper limit", got=math.radians(40.0), bound=math.radians(30.0), origin="settings")
    assert (error.axis, error.limit, error.origin) == ("tilt", "upper limit", "settings")
    assert (error.got, error.bound) == pytest.approx((math.radians(40.0), math.radians(30.0)))
    assert str(error) == "tilt: got 40.0000 deg; the upper limit is 30.0000 deg (settings)"
