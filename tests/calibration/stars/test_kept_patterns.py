"""Patterns of stars from a file are those that are made, to the last bit."""

from pathlib import Path

import tetra3rs

from tests.calibration.stars.kept_patterns import keeping_solver


def test_patterns_from_a_file_are_those_that_are_made(tmp_path: Path) -> None:
    given = {"max_fov_deg": 29.0, "min_fov_deg": 20.0, "lattice_field_oversampling": 20}
    generate = keeping_solver(tmp_path).SolverDatabase.generate_from_gaia
    made, kept = generate(**given), generate(**given)
    (file,) = tmp_path.glob("*.bin")
    for name, database in (("a", tetra3rs.SolverDatabase.generate_from_gaia(**given)), ("b", made), ("c", kept)):
        database.save_to_file(str(tmp_path / name))
        assert (tmp_path / name).read_bytes() == file.read_bytes()
    # of another year, others
    generate(**given, epoch_proper_motion_year=2000.0)
    first, second = tmp_path.glob("*.bin")
    assert first.read_bytes() != second.read_bytes()
