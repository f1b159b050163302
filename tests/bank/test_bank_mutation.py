"""The detector that is made worse by hand: the line that is changed is in the program."""

from pathlib import Path

import bank_mutation


def test_a_copy_withholds_every_fifth_detection(tmp_path: Path) -> None:
    folder = bank_mutation.made_worse(tmp_path / "worse")
    source = (folder / bank_mutation.DETECTOR).read_text(encoding="utf-8")
    assert source.count(bank_mutation.WITHHELD + bank_mutation.LINE) == 1
    before = (bank_mutation.ROOT / bank_mutation.DETECTOR).read_text(encoding="utf-8")
    assert source.replace(bank_mutation.WITHHELD, "") == before
    compile(source, bank_mutation.DETECTOR, "exec")
