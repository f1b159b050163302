"""One run in a few sentences: coverage, accuracy, and consistency of the stated covariance; and remarks on them."""

from typing import Any

_CONSISTENT_LOW, _CONSISTENT_HIGH = 0.6, 1.6


_REFERENCES = (("truth", "the exact positions"), ("dgps", "DGPS"))


def plain_summary(summary: dict[str, Any]) -> str:
    """Return the verdict on a run in two or three sentences: before them what of its inputs cannot be right."""
    sentences = [f"The inputs cannot be right: {line}." for line in summary.get("contradictions", ())]
    sentences.append(_coverage(summary))
    if summary.get("no_track"):
        return " ".join([*sentences, f"{_sentence(summary['no_track'])}."])
    found = _best_reference(summary)
    if found is None:
        sentences.append("There is no usable reference to compare with, so nothing can be said about its errors.")
    else:
        table, words = found
        sentences += [_accuracy(table, words), _consistency(table)]
    return " ".join(sentence for sentence in sentences if sentence)


def plain_remarks(summary: dict[str, Any]) -> str:
    """Return remarks on the comparison: gain over triangulation, use of DGPS, parts left out."""
    sentences = []
    found = None if summary.get("no_track") else _best_reference(summary)
    better = None if found is None else found[0]["total"]["common"]["improvement_percent"]
    if better:
        gains = ", ".join(f"{abs(v):.0f}\u202f% {'better' if v >= 0 else 'worse'}" for v in better)
        sentences.append(f"In x, y and z the filter is {gains} than triangulating each pair alone.")
    taught_s = summary["calibration"]["learnt_until_s"]
    if taught_s is not None:
        learnt = f"Until {taught_s:.1f} s of the DGPS clock the filter used the DGPS"
        exact = (
            "; the comparison with the exact positions holds those pairs, too" if "truth" in summary["accuracy"] else ""
        )
        sentences.append(f"{learnt}{exact}.")
    bad = sorted({span["reason"] for span in summary["reference"]["excluded"]})
    if bad:
        sentences.append(f"Parts of the DGPS log were left out ({', '.join(bad)}).")
    return " ".join(sentences)


def _best_reference(summary: dict[str, Any]) -> tuple[dict[str, Any], str] | None:
    """Return the accuracy against the better reference with its name in words; None without any."""
    for name, words in _REFERENCES:
        table = summary["accuracy"].get(name)
        if table is not None and table["total"]["ekf"]["rmse_m"]:
            return table, words
    return None


def _sentence(line: str) -> str:
    """Return a line of the log as a sentence without its full stop."""
    return line[0].upper() + line[1:]


def _coverage(summary: dict[str, Any]) -> str:
    """Return a sentence on the share of stereo pairs with an estimate."""
    counts = summary["counts"]["track"]
    total = sum(counts.values())
    if not total:
        return "No stereo pair was processed."
    fixed = counts["tracking"] + counts["coasting"]
    if not fixed:
        return f"The aircraft was not found in any of the {total} stereo pairs."
    coasting = f", {counts['coasting']} of them bridged by prediction" if counts["coasting"] else ""
    lost = f" and lost in {counts['lost']}" if counts["lost"] else ""
    share = f"{100 * fixed / total:.0f}\u202f%"
    return f"The aircraft was located in {fixed} of {total} stereo pairs ({share}{coasting}){lost}."


def _accuracy(table: dict[str, Any], words: str) -> str:
    """Return a sentence on the errors."""
    x, y, z = (_length(value) for value in table["total"]["ekf"]["rmse_m"])
    return f"Against {words} it was off by {x} sideways, {y} along the runway and {z} in height (root mean square)."


def _consistency(table: dict[str, Any]) -> str:
    """Say whether the stated uncertainty fits the errors."""
    if table["anees"] is None:
        return ""
    anees = table["anees"]["mean"]
    if anees > _CONSISTENT_HIGH:
        return f"The filter is too sure of itself: its errors are {anees**0.5:.1f} times as large as it states."
    if anees < _CONSISTENT_LOW:
        return f"The filter is too cautious: its errors are {anees**0.5:.1f} times what it states."
    return "Its stated uncertainty fits the errors."


def _length(value_m: float) -> str:
    """Say a length in the unit a person would."""
    if value_m >= 0.995:
        return f"{value_m:.2f} m"
    return f"{100 * value_m:.0f} cm" if value_m >= 0.0995 else f"{100 * value_m:.1f} cm"
