"""`edgemap run --ros2`: the flags for publishing, and the sink that publishes."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from edgemap.cli.arguments import OptionError, arg

if TYPE_CHECKING:
    from edgemap.geometry.camera.floor import FloorCamera
    from edgemap.runtime.inputs.cameras.protocol import Camera
    from edgemap.runtime.outputs.publishers.ros2 import Ros2Sink
    from edgemap.runtime.step.edits import Edits

WheelTopic = Annotated[
    str | None,
    arg(
        metavar="/TOPIC",
        help="Wheel odometry (nav_msgs/Odometry) for --odometry hybrid: a topic of the recording, or a live ROS 2 one.",
    ),
]
ImuTopic = Annotated[
    str | None,
    arg(
        metavar="/TOPIC",
        help="Inertial samples (sensor_msgs/Imu): a topic of the recording, or a live ROS 2 one. tf must join its "
        "frame to the camera's.",
    ),
]
DepthTopicName = Annotated[
    str | None,
    arg(
        name="depth-topic",
        metavar="/TOPIC",
        help="Depth of the pictures' own pixels (sensor_msgs/Image 16UC1 or 32FC1, or compressedDepth), of ros2: or a "
        "recording; by default a topic .../aligned_depth_to_color/... is taken.",
    ),
]
FRAMES = "map,odom,base_link,camera_optical_frame"


@dataclass(frozen=True)
class Ros2Outputs:
    """Results as live ROS 2 topics."""

    ros2: Annotated[
        bool,
        arg(
            help="Publish results live as ROS 2 topics (docs/ros2.md). Files are then paced by their stamps, as "
            "--realtime does. ROS_DOMAIN_ID and the other variables of ROS 2 say who may find them: programs on this "
            "machine where none is set."
        ),
    ] = False
    ros2_pictures: Annotated[bool, arg(help="With --ros2: publish the pictures too (JPEG).")] = False
    ros2_best_effort: Annotated[
        bool, arg(help="With --ros2: boxes and pictures best effort, for lossy radio; reliable otherwise.")
    ] = False
    ros2_namespace: Annotated[str, arg(metavar="NAME", help="With --ros2: before every topic but tf.")] = "edgemap"
    ros2_frames: Annotated[
        str,
        arg(metavar="MAP,ODOM,BASE,CAMERA", help="With --ros2: names of the frames; the base is on the floor."),
    ] = FRAMES
    odom_tf: Annotated[
        bool,
        arg(
            help="With --ros2: --no-odom-tf where the robot itself publishes odom -> base; map -> odom builds on that."
        ),
    ] = True

    def ros2_sinks(self, source: "Camera", floor: "FloorCamera", edits: "Edits") -> "list[Ros2Sink]":
        """The sink that publishes, where it is asked for. Raises OptionError, Ros2Error or MissingExtraError."""
        if not self.ros2:
            return []
        from edgemap.runtime.frames.messages.topics import FrameIds
        from edgemap.runtime.inputs.ros2.node import shared_node
        from edgemap.runtime.outputs.publishers.ros2 import Ros2Options, Ros2Sink

        options = Ros2Options(
            self.ros2_namespace, FrameIds(*frame_names(self.ros2_frames)), self.ros2_pictures, self.ros2_best_effort,
            self.odom_tf,
        )  # fmt: skip
        return [Ros2Sink(shared_node(), floor, options, ros_time=source.name.startswith("ros2:"), edit=edits.submit)]


def frame_names(frames: str) -> list[str]:
    """The four frame names in the text of `--ros2-frames`. Raises OptionError."""
    names = [name.strip() for name in frames.split(",")]
    if len(names) != 4 or not all(names) or len(set(names)) != 4:
        raise OptionError(f"--ros2-frames {frames}: four different names, as in {FRAMES}")
    return names
