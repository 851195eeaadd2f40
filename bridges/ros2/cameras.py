"""Camera kinds of ROS 2: live topics, `ros2:/topic`, and recordings, `FILE.mcap[#/topic]`. Heavy imports inside."""

from typing import TYPE_CHECKING

from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.frames.camera import Camera, CameraOptions, SensorTopics
from edgemap.runtime.frames.reading import user_path
from edgemap.runtime.inputs.cameras.kinds import CameraKind, FileKind

if TYPE_CHECKING:
    from edgemap.runtime.frames.trajectory import Trajectory


class TopicKind(CameraKind):
    """`ros2:/topic`, with depth from another topic. `ros2 topic list` shows the topics."""

    def open(self, address: str, how: CameraOptions) -> Camera:
        """Subscribes. Raises CameraError where nobody publishes pictures there, BridgeError or MissingExtraError."""
        from edgemap.bridges.ros2.dds.camera import Ros2Camera
        from edgemap.bridges.ros2.dds.node import shared_node

        return Ros2Camera(shared_node(), address, how)


class RecordingKind(FileKind):
    """`FILE.mcap[#/topic]`: ours, or a bag of ROS 2."""

    def open(self, address: str, how: CameraOptions) -> Camera:
        """Opens the file. Raises CameraError."""
        from edgemap.bridges.ros2.recordings.camera import recording_camera

        return recording_camera(address, how)

    def wheels(self, address: str) -> "Trajectory":
        """The wheels' poses in the file. Raises CameraError."""
        from edgemap.bridges.ros2.recordings.foreign import read_wheel

        return read_wheel(address)

    def recorded_from(self, address: str) -> str | None:
        """The camera that a recording names; None for a recording of another program, or a damaged one."""
        from edgemap.bridges.ros2.recordings.facts import RECORD
        from edgemap.bridges.ros2.recordings.reader import open_reading

        try:
            recording = open_reading(user_path(address.partition("#")[0]))
        except EdgemapError:  # opening the camera reports what is wrong with it
            return None
        recording.close()
        return recording.metadata.get(RECORD, {}).get("camera")


TOPICS, RECORDINGS = TopicKind(), RecordingKind()


def add_sensors(camera: Camera, topics: SensorTopics) -> Camera:
    """The camera with wheels and IMU on live ROS 2 topics, where any are named. Closes the camera where that fails.

    Raises CameraError, BridgeError or MissingExtraError.
    """
    if not (topics.wheels or topics.imu):
        return camera
    from edgemap.bridges.ros2.dds.camera import Ros2SensorsCamera
    from edgemap.bridges.ros2.dds.node import shared_node

    try:
        return Ros2SensorsCamera(camera, shared_node(), topics)
    except BaseException:
        camera.close()
        raise
