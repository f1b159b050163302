"""ROS 2 messages and topics, by `rosbags`, an optional part."""

from pathlib import Path
from typing import Any

import numpy as np

from groundstation.arrays import FloatArray
from groundstation.errors import MissingExtraError
from groundstation.geometry.camera import Lens

# the frame of positions: the session's, not east-north-up, unless session.toml says so
MAP_FRAME = "runway"
OFFSET_KEY = "groundstation/time_offset_s"
# of what is not known; ROS's own word, zero, stands for a whole covariance only
UNKNOWN_VARIANCE = 1e6
_TOPICS = {
    "image": "/{}/image_raw/compressed",
    "info": "/{}/camera_info",
    "joints": "/{}/joint_states",
}


def topic_of(station: str, kind: str) -> str:
    """Return the topic on which a station's images, camera infos ("info") or joints are written."""
    return _TOPICS[kind].format(station)


def pixel_topic(station: str) -> str:
    """Return the topic of pixels that another program has found."""
    return f"/{station}/target_pixel"


def frame_topic(station: str) -> str:
    """Return the topic of what pictures told of a head's angles: pan, tilt and one sigma as x, y and z, rad."""
    return f"/{station}/frame_angles"


class RosTypes:
    """The message types of ROS 2 Humble, with makers of those used here.

    Raises `MissingExtraError` where rosbags is not installed.
    """

    def __init__(self) -> None:
        try:
            from rosbags.typesys import Stores, get_typestore
        except ImportError as fault:
            raise MissingExtraError("a ROS 2 bag", "ros") from fault
        self._store = get_typestore(Stores.ROS2_HUMBLE)

    def new(self, kind: str, **fields: Any) -> Any:
        """Return a message of a type."""
        return self._store.types[kind](**fields)

    def coded(self, message: Any, kind: str) -> memoryview:
        """Return a message in CDR."""
        return self._store.serialize_cdr(message, kind)

    def decoded(self, data: bytes, kind: str) -> Any:
        """Return a message of a type from CDR."""
        return self._store.deserialize_cdr(data, kind)

    def knows(self, kind: str) -> bool:
        """Return whether a type is one of ROS's own."""
        return kind in self._store.types

    def new_bag(self, folder: Path) -> Any:
        """Return a writer of MCAP storage, which is the default of ROS 2 since Iron, not opened yet."""
        from rosbags.rosbag2 import StoragePlugin, Writer

        return Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP)

    def add_topic(self, writer: Any, topic: str, kind: str, *, latched: bool) -> Any:
        """Add a topic; ``latched`` for one whose last message late subscribers get."""
        from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

        never = QosTime(0, 0)
        quality = Qos(
            history=QosHistory.KEEP_LAST,
            depth=1 if latched else 10,
            reliability=QosReliability.RELIABLE,
            durability=QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE,
            deadline=never,
            lifespan=never,
            liveliness=QosLiveliness.AUTOMATIC,
            liveliness_lease_duration=never,
            avoid_ros_namespace_conventions=False,
        )
        return writer.add_connection(topic, kind, typestore=self._store, offered_qos_profiles=[quality])

    def header(self, stamp_ns: int, frame: str) -> Any:
        """Return a header."""
        stamp = self.new("builtin_interfaces/msg/Time", sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
        return self.new("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

    def vector(self, values: FloatArray) -> Any:
        """Return a vector (3,)."""
        x, y, z = (float(v) for v in values)
        return self.new("geometry_msgs/msg/Vector3", x=x, y=y, z=z)

    def pose(self, position_m: FloatArray, covariance_m2: FloatArray) -> Any:
        """Return a pose with covariance, of a position (3,) with covariance (3, 3); its attitude is unknown."""
        x, y, z = (float(v) for v in position_m)
        full = np.zeros((6, 6))
        full[:3, :3] = covariance_m2
        # half a turn, one sigma, of each angle: no attitude is measured
        full[3:, 3:] = np.eye(3) * np.pi**2
        at = self.new("geometry_msgs/msg/Point", x=x, y=y, z=z)
        level = self.new("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
        pose = self.new("geometry_msgs/msg/Pose", position=at, orientation=level)
        return self.new("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=full.ravel())

    def twist(self, velocity_m_s: FloatArray, unknown: float) -> Any:
        """Return a twist with covariance, of a velocity (3,); all its variances are ``unknown``."""
        twist = self.new("geometry_msgs/msg/Twist", linear=self.vector(velocity_m_s), angular=self.vector(np.zeros(3)))
        return self.new("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=(np.eye(6) * unknown).ravel())

    def camera_info(self, header: Any, lens: Lens) -> Any:
        """Return the calibration of a lens."""
        (w, h), (fx, fy), (cx, cy) = lens.image_size_px, lens.focal_px, lens.principal_point_px
        k = np.array([fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0])
        region = self.new(
            "sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        )
        return self.new(
            "sensor_msgs/msg/CameraInfo",
            header=header,
            height=h,
            width=w,
            distortion_model="plumb_bob",
            d=np.array(lens.distortion, np.float64),
            k=k,
            r=np.eye(3).ravel(),
            p=np.insert(k.reshape(3, 3), 3, 0.0, axis=1).ravel(),
            binning_x=0,
            binning_y=0,
            roi=region,
        )
