"""Blocks that show what a command prints: here the quick commands are run, the others by `make docs-check`."""

import re
from pathlib import Path

import pytest
from pages.printed import Output, differs, needed_before, outputs, pages_with_outputs, printed, rewritten
from pages.workshop import Ran, Workshop

from tests.docs.inputs import prepare
from tests.docs.long_blocks import printed_by_docs_check, printed_by_test
from tests.docs.pages import PAGES, ROOT, text_of

OUTPUTS = [output for page in pages_with_outputs() for output in outputs(page)]
COMPARED = [output for output in OUTPUTS if not output.vary]


def name_of(output: Output) -> str:
    return f"{output.page.name}: {output.text.splitlines()[0][:30]}"


def test_each_block_of_text_has_its_command() -> None:
    """Expected: no `text` block without one, and none between the two that run them."""
    for page in PAGES:
        if page.parent != ROOT / "docs" / "notes":
            shown = len(re.findall(r"^```text$", text_of(page), re.MULTILINE))
            assert shown == sum(output.page == page for output in OUTPUTS), page.name
            # and an output is not shown in a block without a language
            assert not re.search(r"^```\ngroundstation: ", text_of(page), re.MULTILINE), page.name
    assert len(OUTPUTS) >= 4
    assert [*printed_by_test(), *printed_by_docs_check()] == sorted(OUTPUTS, key=lambda o: o not in printed_by_test())


@pytest.mark.parametrize("output", printed_by_test(), ids=name_of)
def test_a_quick_command_prints_what_the_page_shows(output: Output, tmp_path: Path) -> None:
    assert differs(output, printed(output, Workshop(tmp_path, prepare))) == []


def test_commands_run_after_those_that_they_need() -> None:
    text = text_of(ROOT / "docs" / "first-flight.md")
    assert needed_before("groundstation replay flights/one --out out/one", text) == [
        "groundstation simulate --out flights/one --wind 4 --seed 7"
    ]
    assert needed_before("groundstation evaluate out/one out/lively --out out/compared", text) == [
        "groundstation simulate --out flights/one --wind 4 --seed 7",
        "groundstation replay flights/one --out out/one",
        "groundstation replay flights/one --config docs/lively.toml --out out/lively",
    ]


def among_others(output: Output) -> Ran:
    """What the block shows, between other lines."""
    return Ran(out="\n".join(["wrote 1 file", *output.lines, "", "wrote 2 files"]) + "\n", err="", status=0)


@pytest.mark.parametrize("output", COMPARED, ids=name_of)
def test_a_changed_digit_is_found(output: Output) -> None:
    """Expected: each figure by itself, off by two in its last digit; one off is another machine's rounding."""
    ran = among_others(output)
    assert differs(output, ran) == []
    found = 0
    for match in re.finditer(r"(?<![\w.,])\d+(?:\.\d+)?(?![\w.]*\d)", ran.out):
        digits = len(match[0].partition(".")[2])
        step = 10.0**-digits
        for by, caught in ((2.0, True), (1.0, False)):
            changed = ran.out[: match.start()] + f"{float(match[0]) + by * step:.{digits}f}" + ran.out[match.end() :]
            if "wrote" not in changed[changed.rfind("\n", 0, match.start()) + 1 : match.start()]:
                faults = differs(output, Ran(out=changed, err="", status=0))
                assert bool(faults) == caught, changed[match.start() - 20 : match.end()]
                found += 1
    assert found >= 8


@pytest.mark.parametrize("output", COMPARED, ids=name_of)
def test_a_changed_word_or_line_is_found(output: Output) -> None:
    ran = among_others(output)
    words = re.findall(r"[a-z]{3,}", " ".join(output.lines))
    for word in dict.fromkeys(words):
        changed = re.sub(rf"(?m)^(?!wrote)(.*?)\b{word}\b", r"\1altered", ran.out)
        assert differs(output, Ran(out=changed, err="", status=0)), word
    if len(output.lines) > 2:
        shorter = ran.out.replace(output.lines[1] + "\n", "", 1)
        assert differs(output, Ran(out=shorter, err="", status=0))


@pytest.mark.parametrize("output", COMPARED, ids=name_of)
def test_a_block_is_written_as_it_is_printed(output: Output) -> None:
    """Expected: the same block from what it shows; another figure where another is printed."""
    assert rewritten(output, among_others(output)) == output.text
    digit = re.compile(r"7(?=\D*\Z)|8(?=\D*\Z)|3(?=\D*\Z)|5(?=\D*\Z)|1(?=\D*\Z)")
    text = among_others(output).out.replace("\n\nwrote 2 files\n", "")
    changed = digit.sub("9", text)
    assert changed != text
    assert rewritten(output, Ran(out=changed, err="", status=0)) != output.text


def test_a_table_whose_figures_vary_is_compared_by_its_words() -> None:
    """Expected: other figures and fewer rows are right; another heading, another form of row and no row are not."""
    (output,) = [output for output in OUTPUTS if output.vary]
    heading, *rows = output.lines
    other = [re.sub(r"\d(?=\d*$)", "7", row) for row in rows]

    def faults(*lines: str) -> list[str]:
        return differs(output, Ran(out="\n".join(["first", *lines, "nose in 3 of 4"]), err="", status=0))

    assert faults(heading, *other) == faults(heading, other[1]) == []
    assert faults(heading.replace("ANEES", "NEES"), *rows)
    assert faults(heading, *rows, "  600–700         5    0.008/0.302      0.24")
    assert faults(heading)
    assert rewritten(output, Ran(out="\n".join([heading, *other]), err="", status=0)) == output.text


def test_a_comment_that_is_not_understood_is_reported(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("<!-- printed by: groundstation config -->\n<!-- sometimes -->\n```text\na\n```\n")
    with pytest.raises(ValueError, match=r"(?s)page.md: a comment that is not understood: .*sometimes"):
        list(outputs(page))


def test_a_command_runs_once_and_has_to_end_as_it_is_stated(tmp_path: Path) -> None:
    """Expected: what it printed is used again, of the same program alone; another exit status is reported."""
    ran = Workshop(tmp_path, prepare).run("groundstation unknown", status=2)
    assert "unknown" in ran.err
    record = tmp_path / "ran.json"
    record.write_text(record.read_text().replace("groundstation unknown", "groundstation kept"))
    assert Workshop(tmp_path, prepare).run("groundstation kept", status=2) == ran
    record.write_text(record.read_text().replace('"program": "', '"program": "other'))
    with pytest.raises(RuntimeError, match=r"(?s)groundstation kept: exit status 2, wanted 0: .*kept"):
        Workshop(tmp_path, prepare).run("groundstation kept")


def test_what_was_left_where_a_command_writes_is_removed(tmp_path: Path) -> None:
    """Expected: a folder that an interrupted run has left is gone before the command runs; one elsewhere is not."""
    left, kept = tmp_path / "work" / "left", tmp_path / "kept"
    for folder in (left, kept):
        folder.mkdir(parents=True)
        (folder / "half.csv").write_text("t_s")
    shop = Workshop(tmp_path / "work", prepare)
    shop.run("groundstation unknown --out left", status=2)
    shop.run("groundstation unknown --out ../kept", status=2)
    assert not left.exists()
    assert (kept / "half.csv").exists()
