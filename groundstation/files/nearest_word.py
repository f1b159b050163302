"""What may have been meant by a word that is none of those known."""

import difflib
from collections.abc import Iterable

_CUTOFF = 0.6


def nearest_word(word: str, known: Iterable[str]) -> str:
    """Return the known word that is nearest to one that is not; "" for none."""
    return next(iter(difflib.get_close_matches(word, sorted(set(known)), n=1, cutoff=_CUTOFF)), "")


def one_of(word: str, known: Iterable[str]) -> str:
    """Return what is wanted in place of an unknown word: one of those known, and which may have been meant."""
    words = sorted(known)
    hint = nearest_word(word, words)
    return "one of " + ", ".join(words) + (f"; did you mean {hint}?" if hint else "")
