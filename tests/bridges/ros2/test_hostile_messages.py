"""Whoever shares the network can send anything: bytes that are no message cost little and raise what is caught."""

import tracemalloc
from random import Random

import pytest

from edgemap.bridges.ros2.messages.definitions import DAMAGE, decoder, encoder

HEADER = {"stamp": {"sec": 1, "nanosec": 2}, "frame_id": "lens"}
MESSAGES = {
    "sensor_msgs/msg/Image": {
        "header": HEADER,
        "height": 2,
        "width": 3,
        "encoding": "bgr8",
        "step": 9,
        "data": bytes(18),
    },
    "sensor_msgs/msg/CompressedImage": {"header": HEADER, "format": "jpeg", "data": bytes(40)},
    "sensor_msgs/msg/CameraInfo": {"header": HEADER, "distortion_model": "plumb_bob", "d": [0.0] * 5},
    "sensor_msgs/msg/Imu": {"header": HEADER},
    "nav_msgs/msg/Odometry": {"header": HEADER, "child_frame_id": "base_link"},
    "tf2_msgs/msg/TFMessage": {"transforms": [{"header": HEADER, "child_frame_id": "a"}] * 3},
}


@pytest.mark.parametrize("kind", sorted(MESSAGES))
def test_damaged_messages_raise_what_is_caught_in_bounded_memory(kind):
    whole, decode, random = encoder(kind)(MESSAGES[kind]), decoder(kind), Random(3)
    assert decode(whole)
    tracemalloc.start()
    for _ in range(200):
        data = bytearray(whole[: random.choice((len(whole), random.randrange(len(whole) + 1)))])
        for _ in range(random.randrange(1, 5)):
            if data:
                at = random.randrange(len(data))
                size = random.choice((1, 4))
                data[at : at + size] = random.choice((b"\xff", b"\x7f", b"\x00", random.randbytes(1))) * size
        try:
            decode(bytes(data))
        except DAMAGE:
            continue
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 5e6
