"""Descriptions of the pipeline's counters: rejected input and station faults."""

from collections.abc import Mapping

_WORDS = {
    "late_ptu": "PTU readings came too late to be used",
    "late_frames": "frames came too late to be used",
    "ptu_spikes": "PTU readings rejected: outliers that the next reading did not confirm",
    "ptu_repeats": "PTU readings not used: the same to the last digit as many before, although encoders have noise",
    "references_refused": "positions of the reference receiver refused",
    "stations_lost": "times a station delivered nothing for a while",
    "stations_doubted": "times a station was suspected of a wrong calibration",
    "stations_excluded": "times a station was left out, its calibration being wrong",
    "excluded_pixels": "pixels of stations that were left out",
    "starts_taken_back": "tracks started and rejected shortly after",
    "begun_anew": "filter resets after a failure",
}


def describe_counts(counts: Mapping[str, int]) -> list[str]:
    """Return a line of text for each non-zero count; a count without a description is given by its name."""
    return [f"{n} {_WORDS.get(name, name.replace('_', ' '))}" for name, n in counts.items() if n]
