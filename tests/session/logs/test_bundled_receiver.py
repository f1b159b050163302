"""The bundled receiver's log is the landing's DGPS, and an independent reader reads it."""

import io

import numpy as np
import pynmeagps

from groundstation.session import load_dgps, load_session
from groundstation.session.logs.placement import place_log
from groundstation.session.logs.read import read_log
from tests.session.logs.bundled_receiver import AZIMUTH_DEG, ORIGIN_DEG_M, RECORDINGS, SIGMA_M, receiver_log


def test_it_equals_the_output_of_its_writer() -> None:
    assert (RECORDINGS / "receiver.nmea").read_bytes() == receiver_log()


def test_it_holds_the_landings_fixes() -> None:
    fixes = load_dgps(load_session(RECORDINGS / "landing-1"))
    log = read_log(RECORDINGS / "receiver.nmea")
    placed = place_log(log, ORIGIN_DEG_M, AZIMUTH_DEG, float(log.gps_s[0]) - round(fixes[0].t_s, 3))
    assert len(placed) == len(fixes) > 200
    np.testing.assert_allclose([f.t_s for f in placed], [f.t_s for f in fixes], atol=6e-4)
    positions = [[f.position_runway_m for f in those] for those in (placed, fixes)]
    np.testing.assert_allclose(*positions, atol=5e-4)
    np.testing.assert_allclose([f.sigma_m for f in placed], [[SIGMA_M, SIGMA_M, 2 * SIGMA_M]] * len(fixes), rtol=1e-6)
    assert {f.status for f in placed} == {"fix"}


def test_pynmeagps_reads_it() -> None:
    reader = pynmeagps.NMEAReader(io.BytesIO((RECORDINGS / "receiver.nmea").read_bytes()), quitonerror=2)
    kinds = [message.msgID for _, message in reader]
    assert kinds == ["RMC", "GGA", "GST"] * (len(kinds) // 3)
    assert len(kinds) == 3 * len(load_dgps(load_session(RECORDINGS / "landing-1")))
