"""Between a session and a ROS 2 bag."""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

from groundstation.conversion.convert import ConversionResult, missing_notes, pass_on
from groundstation.conversion.device_records import DeviceRecords, folder_files, without_axes
from groundstation.conversion.reference_cut import cut_fixes, cut_references, session_part
from groundstation.conversion.ros_bag_reader import RosBag
from groundstation.conversion.ros_bag_writer import RosBagWriter, track_table
from groundstation.conversion.session_folder_writer import SessionFolderWriter
from groundstation.errors import InputError
from groundstation.files.text_file import AttachedFiles
from groundstation.rig.rig import EQUAL_CLOCKS, Rig, load_rig
from groundstation.session import Session, load_dgps, load_session
from groundstation.session.folder import read_session
from groundstation.session.media import Medium, MediumKind
from groundstation.sources.session_source import session_source

_KEPT = ("session.toml", "rig.toml")
# the rig that makes the bag's events of the devices' stamps and readings; rig.toml is that of angles, as the joints are
_DEVICE_RIG = "device_rig.toml"
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
    session = _corrected(load_session(source))
    session.rig.require_known()
    notes: list[str] = []
    track = None if run is None else track_table(run / "track.csv")
    files = {name: (session.folder / name).read_bytes() for name in _KEPT}
    files[_DEVICE_RIG] = files["rig.toml"]
    changed = [s.name for s in session.rig.stations if not session.reading_axes(s).is_ideal_apart_from_lean]
    if changed:
        files["rig.toml"] = without_axes(load_rig(session.folder / "rig.toml"), changed)
        notes.append(
            f"the angles of {', '.join(changed)} are corrected by ptu_axes, which rig.toml of the bag therefore lacks;"
            f" {_DEVICE_RIG} has them, for a folder made of the bag"
        )
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
    The folder has the devices' stamps and readings: of a bag of ours as the rig in it gives them back, of another the
    bag's own. Raises `InputError`, or `MissingExtraError` without rosbags.
    """
    with RosBag(source) as bag:
        own_files = _own_files(bag)
        files = own_files if rig is None else {**own_files, "rig.toml": _rig_file(rig)}
        if "rig.toml" not in files:
            raise InputError(str(source), got="a bag without a calibration of the stations", wanted="--rig FILE")
        attached = AttachedFiles(source.name, files)
        known = load_rig(attached / "rig.toml" if rig is None else rig)
        chosen = bag.topics(known, topics or {})
        media = dict.fromkeys(chosen.images, Medium(kind=MediumKind.IMAGES, path=source))
        session = read_session(attached, source.name, known, frozenset(), media)
        devices, notes = DeviceRecords(()), []
        if bag.is_ours and "rig.toml" in own_files:
            own = AttachedFiles(source.name, own_files)
            corrected_by = read_session(own, source.name, load_rig(own / "rig.toml"), frozenset(), media)
            devices = DeviceRecords(corrected_by.rig.stations, corrected_by.applied_axes)
            if _DEVICE_RIG not in bag.files:
                notes += _doubts(corrected_by.rig, known)
        files, remarks = folder_files(files, known, devices.kept)
        folder = SessionFolderWriter(out, session, devices)
        events, fault = pass_on(bag.events(chosen, known), folder.take, progress, bag.pairs(chosen))
        if chosen.reference is not None:
            try:
                # the folder keeps [clocks], which maps its table to the DGPS clock of the bag's stamps
                files["dgps.csv"] = bag.reference_csv(chosen.reference, session.clocks.get("dgps", EQUAL_CLOCKS))
            except InputError as damaged:
                fault = fault or damaged
        folder.finish(files, "")
        notes += [f"{n} messages of joints lack pan or tilt of {station}" for station, n in bag.without_angles.items()]
    return ConversionResult(out=out, events=events, notes=(*remarks, *notes), fault=fault)


def _corrected(session: Session) -> Session:
    """Return a session whose events are corrected by its rig, also those of an early recording of operation."""
    recorded = session.recorded
    return session if recorded is None else replace(session, recorded=replace(recorded, rig_replaced=True))


def _own_files(bag: RosBag) -> dict[str, bytes]:
    """Return the session's own files that a bag carries, with the rig by which its events are corrected."""
    carried = bag.files
    files = {name: data for name, data in carried.items() if name in (*_KEPT, _TRUTH)}
    files.setdefault("session.toml", b'origin = "a ROS 2 bag"\n')
    if _DEVICE_RIG in carried:
        files["rig.toml"] = carried[_DEVICE_RIG]
    return files


def _doubts(own: Rig, wanted: Rig) -> list[str]:
    """Return a note where angles of a bag of an earlier version may be corrected twice."""
    names = [s.name for s in wanted.stations if not s.fixed and not s.ptu_axes.is_ideal_apart_from_lean]
    doubtful = [name for name in names if name in own.names and own[name].ptu_axes.is_ideal_apart_from_lean]
    if not doubtful:
        return []
    what = (
        f"the bag is of an earlier version, whose angles of {', '.join(doubtful)} are corrected already if its session"
    )
    return [f"{what} had ptu_axes: those of --rig are then applied to them once more; convert the session itself"]


def _rig_file(path: Path) -> bytes:
    if not path.is_file():
        raise InputError(str(path), got="no such file", wanted="a rig file")
    return path.read_bytes()
