"""Between a session and a ROS 2 bag."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import NoReturn

from groundstation.conversion.convert import ConversionResult, missing_notes, pass_on
from groundstation.conversion.corrected_rig import corrected_rig
from groundstation.conversion.reference_cut import cut_fixes, cut_references, session_part
from groundstation.conversion.ros_bag_reader import RosBag
from groundstation.conversion.ros_bag_writer import RosBagWriter, track_table
from groundstation.conversion.session_folder_writer import SessionFolderWriter
from groundstation.errors import InputError
from groundstation.files.text_file import AttachedFiles
from groundstation.messages import Event, Frame, PixelMeasurement, PtuSample
from groundstation.rig.rig import EQUAL_CLOCKS, load_rig
from groundstation.session import Session, load_dgps, load_session
from groundstation.session.folder import read_session
from groundstation.session.media import Medium, MediumKind
from groundstation.sources.session_source import session_source

_KEPT = ("session.toml", "rig.toml")
# carried where it is not too long for the bag's metadata
_TRUTH, _MOST_TRUTH_BYTES = "truth.csv", 5_000_000
_METADATA = "metadata.yaml"


def is_ros_bag(path: Path) -> bool:
    """Return whether a path is the folder of a ROS 2 bag."""
    return (path / _METADATA).is_file() and not (path / "session.toml").exists()


def to_ros_bag(
    source: Path,
    out: Path,
    *,
    run: Path | None = None,
    from_s: float | None = None,
    to_s: float | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> ConversionResult:
    """Write a session as a ROS 2 bag, with the track of a run (a folder with track.csv) if one is given.

    Raises `InputError`, or `MissingExtraError` without rosbags.
    """
    session = load_session(source)
    session.rig.require_known()
    notes: list[str] = []
    track = None if run is None else track_table(run / "track.csv")
    files = {name: (session.folder / name).read_bytes() for name in _KEPT}
    files["rig.toml"], remarks = corrected_rig(session.rig, files["rig.toml"])
    notes += remarks
    if (session.folder / _TRUTH).is_file() and len(
        truth := (session.folder / _TRUTH).read_bytes()
    ) <= _MOST_TRUTH_BYTES:
        files[_TRUTH] = truth
    part = session_part(session, from_s, to_s)
    files = cut_references(files, session, part)
    fixes = cut_fixes(load_dgps(session, lambda fault: notes.append(str(fault)), notes.append), part)
    with session_source(session, from_s, to_s) as stream:
        begins_s = min([stream.span_s[0] - 1.0, *(fix.t_s for fix in fixes[:1])])
        with RosBagWriter(out, session, begins_s, files) as bag:
            events, fault = pass_on(stream, bag.take, progress, stream.epoch_count)
            bag.write_reference(fixes)
            if track is not None:
                part_s = (-math.inf if from_s is None else from_s, math.inf if to_s is None else to_s)
                notes.append(f"{bag.write_track(track, part_s)} estimates of {run} are on /track")
        if bag.partial_pictures:
            notes.append(f"{bag.partial_pictures} pictures hold only what detection read; the rest is grey")
        if bag.pixels_with_sigma:
            notes.append(f"the sigmas of {bag.pixels_with_sigma} pixels are not in the bag")
        notes += [f"{count} {what} are not in the bag" for what, count in sorted(bag.left_out.items())]
        notes += missing_notes(stream)
    return ConversionResult(out=out, events=events, notes=tuple(notes), fault=fault)


def from_ros_bag(
    source: Path,
    out: Path,
    *,
    rig: Path | None = None,
    topics: Mapping[str, str] | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> ConversionResult:
    """Write a ROS 2 bag as a session folder.

    ``rig`` is a rig file, which a bag that this program has written carries; ``topics`` as of `RosBag.topics`.
    Raises `InputError`, or `MissingExtraError` without rosbags.
    """
    with RosBag(source) as bag:
        files = {name: data for name, data in bag.files.items() if name in (*_KEPT, _TRUTH)}
        files.setdefault("session.toml", b'origin = "a ROS 2 bag"\n')
        if rig is not None:
            files["rig.toml"] = rig.read_bytes() if rig.is_file() else _no_rig(rig)
        if "rig.toml" not in files:
            raise InputError(str(source), got="a bag without a calibration of the stations", wanted="--rig FILE")
        attached = AttachedFiles(source.name, files)
        known = load_rig(attached / "rig.toml")
        chosen = bag.topics(known, topics or {})
        medium = Medium(kind=MediumKind.IMAGES, path=source)
        session = read_session(attached, source.name, known, frozenset(), dict.fromkeys(chosen.images, medium))
        folder = SessionFolderWriter(out, session)
        stream = bag.events(chosen, known)
        if not bag.is_ours:
            stream = _by_the_devices_clocks(stream, session)
        events, fault = pass_on(stream, folder.take, progress, bag.pairs(chosen))
        if chosen.reference is not None:
            try:
                # the folder keeps [clocks], which maps its table to the DGPS clock of the bag's stamps
                files["dgps.csv"] = bag.reference_csv(chosen.reference, session.clocks.get("dgps", EQUAL_CLOCKS))
            except InputError as damaged:
                fault = fault or damaged
        folder.finish(files, "")
        notes = [f"{n} messages of joints lack pan or tilt of {station}" for station, n in bag.without_angles.items()]
    return ConversionResult(out=out, events=events, notes=tuple(notes), fault=fault)


def _by_the_devices_clocks(events: Iterable[Event], session: Session) -> Iterator[Event]:
    """Yield events at session time, whose stamps are the devices': as the rig says of their clocks."""
    for event in events:
        if isinstance(event, PtuSample):
            clock = session.ptu_clock(session.rig[event.station])
        elif isinstance(event, Frame | PixelMeasurement):
            clock = session.camera_clock(session.rig[event.station])
        else:
            yield event
            continue
        yield replace(event, t_s=clock.session_from_device(event.t_s))


def _no_rig(path: Path) -> NoReturn:
    raise InputError(str(path), got="no such file", wanted="a rig file")
