"""Depth pictures of a floor, a wall and a table by ray casting, and a RealSense recording of them."""

import time
from pathlib import Path

import numpy as np

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount

LENS = Intrinsics(640, 480, 615.2, 615.4, 321.1, 239.7)
WALL_M, TABLE_M, TABLE_TOP_M = 3.0, (0.9, 1.8, -0.2, 0.9), 0.3  # ahead; x and y ranges; above the floor


def depth_room(mount: Mount, lens: Intrinsics = LENS, noise: float = 0.0, seed: int = 0) -> np.ndarray:
    """(H, W) float32 metres along the optical axis. noise: relative standard deviation at 1 m, growing with depth."""
    v, u = np.mgrid[0 : lens.height, 0 : lens.width]
    rays = lens.rays(np.column_stack([u.ravel(), v.ravel()])) @ mount.rotation_base_optical().T
    place = mount.position_base_m()
    with np.errstate(divide="ignore", invalid="ignore"):
        floor = -place[2] / rays[:, 2]
        wall = (WALL_M - place[0]) / rays[:, 0]
        top = (TABLE_TOP_M - place[2]) / rays[:, 2]
    x, y = place[0] + top * rays[:, 0], place[1] + top * rays[:, 1]
    on_table = (top > 0) & (x > TABLE_M[0]) & (x < TABLE_M[1]) & (y > TABLE_M[2]) & (y < TABLE_M[3])
    depth = np.fmin(np.where(floor > 0, floor, np.inf), np.where(wall > 0, wall, np.inf))
    depth = np.where(on_table, top, depth).reshape(lens.height, lens.width)
    depth = depth + noise * depth**2 * np.random.default_rng(seed).standard_normal(depth.shape)
    return np.where((depth > 0.2) & (depth < 8.0), depth, 0.0).astype(np.float32)


def record_depth(path: Path, depths_m: list[np.ndarray], apart_m: float = 0.0) -> Path:
    """A `.db3` by librealsense's software device and recorder: colour, and depth in millimetres by a sensor whose
    origin lies apart_m left of the colour lens."""
    from reliability.record_realsense import recording, rs, send, software_device, video_stream

    device = software_device(3)
    colour, stereo = device.add_sensor("RGB Camera"), device.add_sensor("Stereo Module")
    stereo.add_read_only_option(rs.option.depth_units, 0.001)
    size, lens = (LENS.width, LENS.height), (LENS.fx, LENS.fy, LENS.cx, LENS.cy)
    colour_profile = colour.add_video_stream(video_stream(size, lens), True)
    depth_stream = video_stream(size, lens, rs.format.z16, 2, rs.stream.depth, 2)
    depth_profile = stereo.add_video_stream(depth_stream, True)
    between = rs.extrinsics()
    between.rotation, between.translation = [1, 0, 0, 0, 1, 0, 0, 0, 1], [-apart_m, 0.0, 0.0]
    depth_profile.register_extrinsics_to(colour_profile, between)
    grey = np.full((LENS.height, LENS.width, 3), 90, np.uint8)
    with recording(path, device, 0.3):
        for number, depth in enumerate(depths_m, start=1):
            stamp_s, millimetres = 1.0 + 0.0333 * number, np.round(1000.0 * depth).astype(np.uint16)
            send(stereo, depth_profile, millimetres, stamp_s, number, depth_units=0.001)
            send(colour, colour_profile, grey, stamp_s, number)
            time.sleep(0.02)
    return path
