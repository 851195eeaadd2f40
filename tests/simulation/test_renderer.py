"""The renderer's pictures against edgemap.geometry: same pixels, same depths."""

import numpy as np
import pytest

from edgemap.geometry.camera.intrinsics import Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.se2 import SE2
from edgemap.simulation.render.mesh import Material, box
from edgemap.simulation.render.scene import LitPart, LitScene

POSE = SE2(1.0, 2.0, 0.4)
# Nothing square, nothing centred: every sign and offset must be right.
INTRINSICS = Intrinsics(320, 240, 290.0, 270.0, 150.3, 128.9)
MOUNT = Mount.from_degrees(0.55, 14.0, roll_deg=6.0, forward_m=0.2, left_m=-0.07)


@pytest.fixture(scope="module")
def markers():
    """Small boxes (2 cm) in front of the robot, their middles (N, 3), and a renderer of them."""
    pytest.importorskip("moderngl")
    from edgemap.geometry.errors import EdgemapError
    from edgemap.simulation.render.renderer import Renderer

    base = np.array([[1.5, 0.0, 0.02], [2.0, 0.5, 0.3], [3.0, -0.9, 0.7], [2.5, 0.9, 0.05], [1.2, -0.2, 0.3]])
    middles = np.column_stack([POSE.apply(base[:, :2]), base[:, 2]])
    parts = []
    for id_, middle in enumerate(middles, start=1):
        for part in box(middle - 0.01, middle + 0.01, Material()).parts:
            light = np.ones(part.positions.shape, dtype=np.float32)
            parts.append(LitPart(id_, part, light, light))
    try:
        made = Renderer(LitScene((), tuple(parts), ()), INTRINSICS)
    except EdgemapError as error:
        pytest.skip(str(error))
    yield middles, made
    made.close()


def optical(points_room):
    """Points of the room in the optical frame, written from the mount alone, apart from the renderer's View."""
    base = POSE.inverse().apply(points_room[:, :2])
    return (np.column_stack([base, points_room[:, 2]]) - MOUNT.position_base_m()) @ MOUNT.rotation_base_optical()


def test_ids_stand_where_geometry_projects_them(markers):
    from edgemap.simulation.render.view import View

    middles, renderer = markers
    frame = renderer.frame(View.of_base(POSE, MOUNT))
    expected = optical(middles)
    pixels = INTRINSICS.project(expected)
    for id_, (pixel, point) in enumerate(zip(pixels, expected, strict=True), start=1):
        rows, columns = np.nonzero(frame.ids == id_)
        assert len(rows) > 3, f"marker {id_} is not in the picture"
        assert np.hypot(columns.mean() - pixel[0], rows.mean() - pixel[1]) < 1.0
        assert abs(np.median(frame.depth_m[rows, columns]) - point[2]) < 0.02
