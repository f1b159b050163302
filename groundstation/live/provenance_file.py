"""`provenance.json` of a live folder: date, program, command, machine, and the station's files with their hashes."""

import json
from collections.abc import Sequence
from pathlib import Path

from groundstation.errors import os_words
from groundstation.files.whole_file import write_whole
from groundstation.live.station_file import StationFile
from groundstation.replay.provenance import file_provenance, program_provenance

NAME = "provenance.json"


def write_provenance(
    out: Path, command: Sequence[str], station: Path | None, file: StationFile, faults: list[str]
) -> None:
    """Write the file; what the disk does not take is a line in ``faults``.

    ``station`` is the station file, None for a simulated range; rig and tuning are those that ``file`` names.
    """
    named = {"station": station, "rig": file.rig, "configuration": file.config}
    if file.panorama is not None:
        named["panorama"] = file.panorama
    table = program_provenance(command) | {
        name: None if path is None else file_provenance(path) for name, path in named.items()
    }
    try:
        write_whole(out / NAME, json.dumps(table, indent=1, ensure_ascii=False) + "\n")
    except OSError as fault:
        faults.append(f"{NAME}: {os_words(fault)}")
