"""Events of a session as a ROS 2 bag, written by `rosbags`; ROS is not needed.

Stamps are session time, moved by a whole number of seconds where a session begins before zero; the bag's custom data
keep that number and the session's own files, so that the bag can be turned into a session again.
"""

import math
import shutil
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from groundstation.arrays import FloatArray
from groundstation.conversion.ros_types import (
    MAP_FRAME,
    OFFSET_KEY,
    UNKNOWN_VARIANCE,
    RosTypes,
    frame_topic,
    pixel_topic,
    topic_of,
)
from groundstation.errors import InputError, os_words
from groundstation.files.csv_table import CsvTable
from groundstation.geometry.rotation import wxyz_from_matrix
from groundstation.geometry.station import StationGeometry
from groundstation.messages import (
    DgpsFix,
    Epoch,
    Event,
    FilterReset,
    Frame,
    FrameAngles,
    Heartbeat,
    PixelMeasurement,
    PtuSample,
    ReferenceFix,
)
from groundstation.rig.rig import Station
from groundstation.session import Session

if TYPE_CHECKING:
    from rosbags.interfaces import Connection

_POSITION = ("x_m", "y_m", "z_m")
_VELOCITY = ("vx_m_s", "vy_m_s", "vz_m_s")
_COVARIANCE = ("cov_xx_m2", "cov_xy_m2", "cov_xz_m2", "cov_yy_m2", "cov_yz_m2", "cov_zz_m2")
_WORDS: dict[type[Event], str] = {
    Heartbeat: "heartbeats",
    ReferenceFix: "positions that the filter learnt from",
    FilterReset: "resets of the filter",
}
_UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


def track_table(path: Path) -> CsvTable:
    """Open the track.csv of a run; raises `InputError` if it or a column is missing."""
    return CsvTable(path, ["t_s", *_POSITION, *_VELOCITY, *_COVARIANCE])


class RosBagWriter:
    """Writes a bag folder, which must not exist; to be used as a context manager.

    Parameters
    ----------
    begins_s : session time of the first record, s.
    files : session.toml, rig.toml and tables, by name, kept in the bag's custom data.

    Raises
    ------
    InputError : the folder exists or cannot be written.
    """

    def __init__(self, folder: Path, session: Session, begins_s: float, files: Mapping[str, bytes]) -> None:
        if folder.exists():
            raise InputError(str(folder), got="something that exists", wanted="a new folder for the bag")
        self._ros = RosTypes()
        self._stations = {s.name: s for s in session.rig.stations}
        self._geometries = {s.name: s.geometry() for s in session.rig.stations}
        self._offset_s = max(0, -math.floor(min(begins_s, 0.0)))
        self._writer = self._ros.new_bag(folder)
        self._writer.set_custom_data(OFFSET_KEY, str(self._offset_s))
        for name, data in files.items():
            self._writer.set_custom_data(f"groundstation/{name}", data.decode("utf-8", "surrogateescape"))
        self._topics: dict[str, Connection] = {}
        self._begins_s = begins_s
        self.pixels_with_sigma = self.partial_pictures = 0
        # records that have no counterpart in ROS, by what they are
        self.left_out: Counter[str] = Counter()

    def __enter__(self) -> "RosBagWriter":
        """Open the bag and write the static transforms."""
        try:
            self._writer.open()
        except OSError as error:
            raise InputError(str(self._writer.path), got=os_words(error), wanted="a folder to write") from error
        self._write_static()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Close the bag, which is then whole; after an error or an interrupt it is removed."""
        self._writer.close()
        if kind is not None:
            shutil.rmtree(self._writer.path, ignore_errors=True)

    def take(self, event: Event) -> None:
        """Write one event; those without a counterpart in ROS are left out and counted."""
        if isinstance(event, Frame):
            self._write_picture(event)
        elif isinstance(event, PtuSample):
            self._write_reading(event)
        elif isinstance(event, PixelMeasurement):
            xyz = (event.u_px, event.v_px, 0.0)
            self._write_point(pixel_topic(event.station), event.t_s, f"{event.station}_optical", xyz)
            self.pixels_with_sigma += event.sigma_px is not None
        elif isinstance(event, FrameAngles) and event.delay_s != 0.0:
            # a point has no place for the time after its stamp at which the head was there
            self.left_out["angles from pictures of a rolling shutter"] += 1
        elif isinstance(event, FrameAngles):
            xyz = (event.pan_rad, event.tilt_rad, event.sigma_rad)
            self._write_point(frame_topic(event.station), event.t_s, f"{event.station}_base", xyz)
        elif not isinstance(event, Epoch):
            self.left_out[_WORDS[type(event)]] += 1

    def write_reference(self, fixes: tuple[DgpsFix, ...]) -> None:
        """Write positions of the reference, with stamps of the DGPS clock, as `load_dgps` gives them."""
        for fix in fixes:
            variance = np.full(3, UNKNOWN_VARIANCE) if fix.sigma_m is None else np.square(fix.sigma_m)
            pose = self._ros.pose(fix.position_runway_m, np.diag(variance))
            message = self._ros.new(
                "geometry_msgs/msg/PoseWithCovarianceStamped", header=self._header(fix.t_s, MAP_FRAME), pose=pose
            )
            self._write("/reference", fix.t_s, message)

    def write_track(self, table: CsvTable, span_s: tuple[float, float]) -> int:
        """Write the track of a run (`track_table`) as odometry, from and to the two times of ``span_s``.

        Returns the number of estimates; raises `InputError`.
        """
        count = 0
        for row in table:
            values = [table.optional_number(row, name) for name in (*_POSITION, *_VELOCITY, *_COVARIANCE)]
            known = [value for value in values if value is not None]
            t_s = table.number(row, "t_s")
            if len(known) < len(values) or not span_s[0] <= t_s <= span_s[1]:
                continue
            covariance = np.zeros((3, 3))
            for (i, j), value in zip(_UPPER, known[6:], strict=True):
                covariance[i, j] = covariance[j, i] = value
            # the twist is in the frame of the pose, whose axes are those of the map: no attitude is known
            message = self._ros.new(
                "nav_msgs/msg/Odometry",
                header=self._header(t_s, MAP_FRAME),
                child_frame_id="aircraft",
                pose=self._ros.pose(np.array(known[:3]), covariance),
                twist=self._ros.twist(np.array(known[3:6]), UNKNOWN_VARIANCE),
            )
            self._write("/track", t_s, message)
            count += 1
        return count

    # --------------------------------------------------------------------------------------- the messages
    def _write_picture(self, event: Frame) -> None:
        """Write a frame as PNG, without loss, and its camera info."""
        station = self._stations[event.station]
        self.partial_pictures += not event.image.has_all
        header = self._header(event.t_s, f"{event.station}_optical")
        coded = cv2.imencode(".png", event.image.preview(), (cv2.IMWRITE_PNG_COMPRESSION, 1))[1]
        message = self._ros.new(
            "sensor_msgs/msg/CompressedImage", header=header, format="bgr8; png compressed", data=coded.ravel()
        )
        self._write(topic_of(event.station, "image"), event.t_s, message)
        self._write(topic_of(event.station, "info"), event.t_s, self._ros.camera_info(header, station.lens))

    def _write_reading(self, event: PtuSample) -> None:
        """Write pan and tilt as joints, and where the camera then is."""
        message = self._ros.new(
            "sensor_msgs/msg/JointState",
            header=self._header(event.t_s, f"{event.station}_base"),
            name=[f"{event.station}_pan", f"{event.station}_tilt"],
            position=np.array([event.pan_rad, event.tilt_rad]),
            velocity=np.zeros(0),
            effort=np.zeros(0),
        )
        self._write(topic_of(event.station, "joints"), event.t_s, message)
        rotation = self._geometries[event.station].base_from_head(event.pan_rad, event.tilt_rad)
        turned = self._transform(event.t_s, f"{event.station}_base", f"{event.station}_head", np.zeros(3), rotation)
        self._write("/tf", event.t_s, self._ros.new("tf2_msgs/msg/TFMessage", transforms=[turned]))

    def _write_point(self, topic: str, t_s: float, frame: str, xyz: tuple[float, float, float]) -> None:
        x, y, z = xyz
        point = self._ros.new("geometry_msgs/msg/Point", x=x, y=y, z=z)
        stamped = self._ros.new("geometry_msgs/msg/PointStamped", header=self._header(t_s, frame), point=point)
        self._write(topic, t_s, stamped)

    def _write_static(self) -> None:
        """Write where the stations' bases are, and the cameras in their heads."""
        transforms = []
        for name, geometry in self._geometries.items():
            transforms += self._fixed_transforms(self._stations[name], geometry)
        self._write("/tf_static", self._begins_s, self._ros.new("tf2_msgs/msg/TFMessage", transforms=transforms))

    def _fixed_transforms(self, station: Station, geometry: StationGeometry) -> list[Any]:
        name, t_s = station.name, self._begins_s
        base = geometry.packed[0:9].reshape(3, 3)
        camera = geometry.packed[12:21].reshape(3, 3)
        found = [
            self._transform(t_s, MAP_FRAME, f"{name}_base", station.ptu_position_m, base),
            self._transform(t_s, f"{name}_head", f"{name}_optical", station.camera_in_head_m, camera),
        ]
        if station.fixed:
            found.append(self._transform(t_s, f"{name}_base", f"{name}_head", np.zeros(3), np.eye(3)))
        return found

    def _transform(self, t_s: float, parent: str, child: str, position_m: FloatArray, rotation: FloatArray) -> Any:
        """Return the transform of a frame: its origin (3,) in the parent's, and parent_from_child (3, 3)."""
        w, x, y, z = (float(v) for v in wxyz_from_matrix(rotation))
        return self._ros.new(
            "geometry_msgs/msg/TransformStamped",
            header=self._header(t_s, parent),
            child_frame_id=child,
            transform=self._ros.new(
                "geometry_msgs/msg/Transform",
                translation=self._ros.vector(position_m),
                rotation=self._ros.new("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w),
            ),
        )

    def _header(self, t_s: float, frame: str) -> Any:
        return self._ros.header(self._stamp_ns(t_s), frame)

    def _stamp_ns(self, t_s: float) -> int:
        """Return a session time as a stamp, ns; nothing is before zero."""
        return max(0, self._offset_s * 10**9 + round(t_s * 1e9))

    def _write(self, topic: str, t_s: float, message: Any) -> None:
        kind = message.__msgtype__
        if topic not in self._topics:
            self._topics[topic] = self._ros.add_topic(self._writer, topic, kind, latched=topic == "/tf_static")
        self._writer.write(self._topics[topic], self._stamp_ns(t_s), self._ros.coded(message, kind))
