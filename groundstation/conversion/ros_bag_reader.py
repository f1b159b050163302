"""A ROS 2 bag as a session: images, joint states and reference positions as events, and the files of the session.

Only messages of ROS's own types are decoded, of topics that are named or can be told by station and type; types that a
bag defines itself are never compiled.
"""

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from mcap.reader import make_reader

from groundstation.conversion.ros_messages import BagEpochs, pan_tilt, plain_image
from groundstation.conversion.ros_types import OFFSET_KEY, UNKNOWN_VARIANCE, RosTypes, frame_topic, pixel_topic
from groundstation.conversion.video_frame_pairing import frames_rows
from groundstation.errors import SessionError
from groundstation.files.image_header import is_decodable
from groundstation.files.output_names import name_fault
from groundstation.files.toml_table import quoted, shown
from groundstation.messages import Epoch, Event, Frame, FrameAngles, PixelMeasurement, PtuSample
from groundstation.picture import BgrPicture, Picture
from groundstation.rig.rig import ClockModel, Rig
from groundstation.session.media import IN_COLOUR

IMAGE_KINDS = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
JOINT_KIND, REFERENCE_KIND = "sensor_msgs/msg/JointState", "geometry_msgs/msg/PoseWithCovarianceStamped"
POINT_KIND = "geometry_msgs/msg/PointStamped"
OWN_REFERENCE = "/reference"
# three bytes for each pixel of the largest picture that is decoded, three times over
_MOST_MESSAGE_BYTES = 250_000_000
_MOST_CHUNK_BYTES = 300_000_000
_MOST_METADATA_BYTES = 20_000_000
_LISTED = 12


@dataclass(frozen=True, slots=True, kw_only=True)
class RosTopics:
    """Topics by station; ``images`` is empty for a bag of pixels. ``reference`` is None without one.

    ``angles`` are the stations, by topic, of which pictures told the angles.
    """

    images: Mapping[str, str]
    joints: Mapping[str, str]
    pixels: Mapping[str, str] = field(default_factory=dict)
    angles: Mapping[str, str] = field(default_factory=dict)
    reference: str | None = None


class RosBag:
    """A bag that is open; to be used as a context manager.

    Raises `SessionError` for a folder that is none, or is damaged.
    """

    def __init__(self, folder: Path) -> None:
        self._ros = RosTypes()
        from rosbags.rosbag2 import Reader, ReaderError

        self.folder = folder
        # what the library raises for files that are damaged
        self._faults = (
            ReaderError,
            ValueError,
            KeyError,
            OSError,
            RuntimeError,
            TypeError,
            AttributeError,
            AssertionError,
        )
        try:
            metadata = self._metadata()
            self._check_chunks(metadata)
            self._reader = Reader(folder)
            self._reader.open()
        except SessionError:
            raise
        except self._faults as error:
            raise SessionError(
                str(folder),
                got=f"no ROS 2 bag ({shown(str(error))})",
                wanted="a folder with metadata.yaml and its files",
            ) from error
        # only texts: an alias of YAML may stand for more than fits into the memory
        custom = metadata.get("custom_data")
        texts = custom.items() if isinstance(custom, dict) else ()
        self._custom = {str(key): text for key, text in texts if isinstance(key, str) and isinstance(text, str)}
        # messages of joints without both angles of a station, by station
        self.without_angles: dict[str, int] = {}
        self._joint_names: dict[str, str] = {}

    def _metadata(self) -> dict[str, Any]:
        """Return the metadata; raises `SessionError` where they are too long, or the bag has no limit when unpacked."""
        from ruamel.yaml import YAML
        from ruamel.yaml.error import YAMLError

        path = self.folder / "metadata.yaml"
        size = path.stat().st_size
        if size > _MOST_METADATA_BYTES:
            raise SessionError(str(path), got=f"{size} bytes", wanted=f"at most {_MOST_METADATA_BYTES}")
        try:
            read = YAML(typ="safe").load(path.read_text(encoding="utf-8"))
        except YAMLError as error:
            raise ValueError("metadata.yaml is no YAML") from error
        found = read.get("rosbag2_bagfile_information") if isinstance(read, dict) else None
        if not isinstance(found, dict):
            raise ValueError("metadata.yaml has no rosbag2_bagfile_information")
        mode = str(found.get("compression_mode", "")).lower()
        if mode not in ("", "none"):
            wanted = "none: `ros2 bag convert` writes it without (compression of MCAP chunks is read)"
            raise SessionError(str(path), got=f"compression by {shown(mode)}", wanted=wanted)
        return dict(found)

    def _check_chunks(self, metadata: dict[str, Any]) -> None:
        """Raise `SessionError` for a chunk of MCAP storage that is too large to be unpacked, by its index."""
        if metadata.get("storage_identifier") != "mcap":
            return
        for name in metadata["relative_file_paths"]:
            path = self.folder / Path(str(name)).name
            with path.open("rb") as stream:
                summary = make_reader(stream).get_summary()
            sizes = [chunk.uncompressed_size for chunk in summary.chunk_indexes] if summary is not None else []
            if max(sizes, default=0) > _MOST_CHUNK_BYTES:
                got, wanted = f"a chunk of {max(sizes)} bytes", f"at most {_MOST_CHUNK_BYTES}"
                raise SessionError(str(path), got=got, wanted=wanted)

    def __enter__(self) -> "RosBag":
        """Return the bag."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the files."""
        self._reader.close()

    @property
    def files(self) -> dict[str, bytes]:
        """Files of a session that this program has put into the bag, by name."""
        prefix = "groundstation/"
        return {
            key.removeprefix(prefix): text.encode("utf-8", "surrogateescape")
            for key, text in self._custom.items()
            if key.startswith(prefix) and key != OFFSET_KEY and name_fault(key.removeprefix(prefix)) is None
        }

    @property
    def is_ours(self) -> bool:
        """Whether this program has written the bag: its stamps are session time."""
        return OFFSET_KEY in self._custom

    @property
    def kinds(self) -> dict[str, str]:
        """Type of each topic."""
        return {c.topic: c.msgtype for c in self._reader.connections}

    def offset_s(self) -> int:
        """Return the whole seconds that session time is behind the stamps."""
        kept = self._custom.get(OFFSET_KEY, "")
        if kept.isascii() and kept.isdigit() and len(kept) < 10:
            return int(kept)
        return int(self._reader.start_time // 10**9)

    def topics(self, rig: Rig, given: Mapping[str, str]) -> RosTopics:
        """Return the topics of the rig's stations: ``given`` ("left.image": topic), else the one that names a station.

        Raises `SessionError`, with the bag's topics, where one is missing or several could be meant.
        """
        turning = [s.name for s in rig.stations if not s.fixed]
        for key in given:
            allowed = [*(f"{n}.image" for n in rig.names), *(f"{n}.joints" for n in turning), "reference"]
            if key not in allowed:
                raise SessionError("--topic", got=quoted(key), wanted="one of " + ", ".join(allowed))
        pixels = {n: pixel_topic(n) for n in rig.names if self.kinds.get(pixel_topic(n)) == POINT_KIND}
        angles = {frame_topic(n): n for n in turning if self.is_ours and self.kinds.get(frame_topic(n)) == POINT_KIND}
        filmed = [n for n in rig.names if not self.is_ours or f"{n}.image" in given or self._has_images(n)]
        images = {} if pixels else {n: self._topic(f"{n}.image", n, IMAGE_KINDS, given) for n in filmed or rig.names}
        for n, topic in images.items():
            others = [other for other, t in images.items() if t == topic and other != n]
            if others:
                raise self._no_topic(f"{n}.image", f"{quoted(topic)}, which is that of {others[0]}, too", IMAGE_KINDS)
        joints = {n: self._topic(f"{n}.joints", n, (JOINT_KIND,), given) for n in turning}
        # of a foreign bag it is not known whether a pose is in the session's frame
        own = OWN_REFERENCE if self.is_ours and self.kinds.get(OWN_REFERENCE) == REFERENCE_KIND else None
        reference = given.get("reference", own)
        if reference is not None and self.kinds.get(reference) != REFERENCE_KIND:
            raise self._no_topic("reference", f"{quoted(reference)}", (REFERENCE_KIND,))
        return RosTopics(images=images, joints=joints, pixels=pixels, angles=angles, reference=reference)

    def _has_images(self, station: str) -> bool:
        """Return whether the bag has pictures of a station by its name: of a part that it missed we wrote none."""
        return any(kind in IMAGE_KINDS and station in t.strip("/").split("/") for t, kind in self.kinds.items())

    def events(self, topics: RosTopics, rig: Rig) -> Iterator[Event]:
        """Yield readings, frames and epochs in the bag's order. Raises `SessionError` for a damaged message."""
        epochs = self._epochs(topics.images or topics.pixels)
        left = {number: set(stations) for number, stations in epochs.stations.items()}
        counts: dict[str, int] = {}
        read: set[str] = set()
        stamps: dict[int, list[float]] = {}
        for topic, message in self._messages(
            {*topics.images.values(), *topics.joints.values(), *topics.pixels.values(), *topics.angles}
        ):
            t_s = self._time_s(message)
            if topic in topics.angles:
                pan, tilt, sigma = (float(getattr(message.point, axis)) for axis in "xyz")
                # as joints: what is no angle is passed over, and a sigma of zero would be believed without limit
                if math.isfinite(pan) and math.isfinite(tilt) and 0.0 < sigma < math.inf:
                    yield FrameAngles(
                        t_s=t_s, station=topics.angles[topic], pan_rad=pan, tilt_rad=tilt, sigma_rad=sigma
                    )
            for station in (n for n, t in topics.joints.items() if t == topic):
                angles = pan_tilt(message, station, alone=list(topics.joints.values()).count(topic) == 1)
                if angles is None:
                    self.without_angles[station] = self.without_angles.get(station, 0) + 1
                    names = ", ".join(shown(str(name), 30) for name in message.name[:_LISTED])
                    self._joint_names[station] = names
                else:
                    read.add(station)
                    yield PtuSample(t_s=t_s, station=station, pan_rad=angles[0], tilt_rad=angles[1])
            for station in (n for n, t in (topics.images or topics.pixels).items() if t == topic):
                k = counts[station] = counts.get(station, -1) + 1
                if k >= len(epochs.numbers[station]):
                    return
                epoch = epochs.numbers[station][k]
                if topics.images:
                    image = self._picture(message, topic, rig[station].lens.image_size_px)
                    yield Frame(t_s=t_s, station=station, epoch=epoch, image=image)
                else:
                    u, v = float(message.point.x), float(message.point.y)
                    yield PixelMeasurement(t_s=t_s, station=station, epoch=epoch, u_px=u, v_px=v)
                stamps.setdefault(epoch, []).append(t_s)
                left[epoch].discard(station)
                if not left[epoch]:
                    own = stamps.pop(epoch)
                    yield Epoch(t_s=sum(own) / len(own), epoch=epoch, stations=tuple(epochs.stations[epoch]))
        self._require_angles(topics, read)

    def _require_angles(self, topics: RosTopics, read: set[str]) -> None:
        """Raise `SessionError` for a station whose angles no message of its topic has."""
        for station, topic in topics.joints.items():
            if station not in read:
                got = f"joints {self._joint_names.get(station, 'of no message')}"
                wanted = f"pan and tilt of {station} by their names, with its own where several share a topic"
                raise SessionError(f"{self.folder.name}: {topic}", got=got, wanted=wanted)

    def pairs(self, topics: RosTopics) -> int:
        """Return the number of messages of the topic that has the most pictures, or pixels."""
        counts = {c.topic: c.msgcount for c in self._reader.connections}
        return max(counts[topic] for topic in (topics.images or topics.pixels).values())

    def reference_csv(self, topic: str, clock: ClockModel) -> bytes:
        """Return the reference positions as dgps.csv, in the receiver's stamps, which ``clock`` maps to the bag's."""
        lines = ["t_s,x_m,y_m,z_m,sigma_x_m,sigma_y_m,sigma_z_m"]
        for _, message in self._messages({topic}):
            at, variance = message.pose.pose.position, np.asarray(message.pose.covariance).reshape(6, 6).diagonal()[:3]
            numbers = [clock.device_from_session(self._time_s(message)), at.x, at.y, at.z]
            if not np.isfinite(numbers).all():
                continue
            # zero is ROS's word for unknown, and one so large that of `RosBagWriter`
            known = bool(((variance > 0.0) & (variance < UNKNOWN_VARIANCE)).all())
            sigma = [repr(float(v)) for v in np.sqrt(variance)] if known else ["", "", ""]
            lines.append(",".join([*(repr(float(number)) for number in numbers), *sigma]))
        return ("\n".join(lines) + "\n").encode()

    # -------------------------------------------------------------------------------------------- messages
    def _messages(self, topics: set[str]) -> Iterator[tuple[str, Any]]:
        """Yield the topic and the decoded message of each record of these topics."""
        connections = [c for c in self._reader.connections if c.topic in topics]
        if not connections:
            return
        records = self._reader.messages(connections=connections)
        number = 0
        while True:
            try:
                record = next(records, None)
                if record is None:
                    return
                connection, _, data = record
                number += 1
                if len(data) > _MOST_MESSAGE_BYTES:
                    raise ValueError(f"{len(data)} bytes, more than {_MOST_MESSAGE_BYTES}")
                message = self._ros.decoded(data, connection.msgtype)
            # the library and those that it unpacks with raise whatever a damaged byte leads to
            except Exception as error:
                where = f"{self.folder.name}: message {number} of {', '.join(sorted(topics))}"
                got = f"a damaged one ({shown(str(error) or type(error).__name__)})"
                raise SessionError(where, got=got, wanted="a ROS 2 message") from error
            yield connection.topic, message

    def _time_s(self, message: Any) -> float:
        """Return the session time of a message's header, s."""
        stamp = message.header.stamp
        return (int(stamp.sec) - self.offset_s()) + int(stamp.nanosec) * 1e-9

    def _epochs(self, topics: Mapping[str, str]) -> BagEpochs:
        """Return which frames belong together: nearest in time, each used once."""
        stamps: dict[str, list[float]] = {station: [] for station in topics}
        try:
            for topic, message in self._messages(set(topics.values())):
                for station in (n for n, t in topics.items() if t == topic):
                    stamps[station].append(self._time_s(message))
        except SessionError:
            # the events before it are wanted all the same, and then raise it again
            pass
        for station, times in stamps.items():
            least = 1 if self.is_ours else 2
            if len(times) < least or any(after <= before for before, after in itertools.pairwise(times)):
                got = f"{len(times)} of them" if len(times) < least else "stamps that do not grow"
                raise SessionError(f"{self.folder.name}: {topics[station]}", got=got, wanted="images in order of time")
        numbers: dict[str, list[int]] = {station: [] for station in topics}
        together: dict[int, list[str]] = {}
        for number, taken in enumerate(frames_rows({n: np.array(t) for n, t in stamps.items()})):
            together[number] = list(taken)
            for station in taken:
                numbers[station].append(number)
        return BagEpochs(numbers=numbers, stations=together)

    def _picture(self, message: Any, topic: str, size_px: tuple[int, int]) -> Picture:
        """Return the picture of a message; raises `SessionError` for one that is damaged, or not of the rig's size."""
        where = f"{self.folder.name}: {topic} at {self._time_s(message):.3f} s"
        data = np.asarray(message.data, np.uint8)
        if message.__msgtype__ == IMAGE_KINDS[1]:
            coded = data.tobytes()
            image = cv2.imdecode(data, IN_COLOUR) if is_decodable(coded) else None
            if image is None:
                raise SessionError(where, got=f"no picture ({message.format[:40]})", wanted="a JPEG or a PNG")
            picture: Picture = BgrPicture(np.asarray(image, np.uint8))
        else:
            picture = plain_image(message, data, where)
        if picture.size_px != size_px:
            got, wanted = (f"{w}×{h} px" for w, h in (picture.size_px, size_px))
            raise SessionError(where, got=got, wanted=f"{wanted} as in the rig")
        return picture

    # ---------------------------------------------------------------------------------------------- errors
    def _topic(self, key: str, station: str, kinds: tuple[str, ...], given: Mapping[str, str]) -> str:
        """Return the topic of a station's data: the given one, or the only one of these types that names it."""
        if key in given:
            if self.kinds.get(given[key]) not in kinds:
                raise self._no_topic(key, quoted(given[key]), kinds)
            return given[key]
        possible = [t for t, kind in self.kinds.items() if kind in kinds]
        named = [t for t in possible if station in t.strip("/").split("/")] or possible
        if len(named) != 1:
            raise self._no_topic(key, "none" if not named else "several: " + ", ".join(sorted(named)[:_LISTED]), kinds)
        return named[0]

    def _no_topic(self, key: str, got: str, kinds: tuple[str, ...]) -> SessionError:
        listed = [f"{topic} ({kind})" for topic, kind in sorted(self.kinds.items())[:_LISTED]]
        wanted = f"--topic {key}=TOPIC of {' or '.join(kinds)}; the bag has {', '.join(listed) or 'no topics'}"
        return SessionError(f"{self.folder.name}: topic of {key}", got=got, wanted=wanted)
