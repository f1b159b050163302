"""Valid documents, damaged: what a slip of the editor, a lost block or another program makes of them."""

from typing import Any

from hypothesis import strategies as st

_SCRAPS = ["", "=", "[", "]", '"', "\n", "-", "nan", "inf", "1e999", "0", "true", "{", "}", ",", "\0", "\ufeff", "é"]
_SCRAPS += ["[[station]]", "[initial]", "9" * 5000, "0x" + "f" * 5000, "-1", "1e-320", "x = 1"]


@st.composite
def damaged(draw: st.DrawFn, text: str) -> bytes:
    """Cut, doubled, overwritten or with scraps of syntax in between."""
    content = text
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, len(content)))
        end = min(len(content), start + draw(st.integers(0, 30)))
        kind = draw(st.sampled_from(["cut", "double", "scrap", "tail", "line"]))
        if kind == "cut":
            content = content[:start] + content[end:]
        elif kind == "double":
            content = content[:end] + content[start:]
        elif kind == "scrap":
            content = content[:start] + draw(st.sampled_from(_SCRAPS)) + content[end:]
        elif kind == "tail":
            content = content[:start]
        else:
            lines = content.split("\n")
            del lines[draw(st.integers(0, len(lines) - 1))]
            content = "\n".join(lines)
    return content.encode()


def toml_values() -> st.SearchStrategy[Any]:
    """Any value that a TOML file can hold."""
    plain = st.one_of(
        st.booleans(),
        st.integers(),
        st.integers(60, 5000).map(lambda power: 16**power),
        st.floats(),
        st.text(max_size=8),
        st.dates(),
    )
    return st.recursive(
        plain,
        lambda v: st.one_of(st.lists(v, max_size=5), st.dictionaries(st.text(max_size=5), v, max_size=3)),
        max_leaves=8,
    )
