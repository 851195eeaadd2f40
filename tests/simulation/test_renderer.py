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


def test_floor_depth_is_that_of_the_ray(drawn, renderer):
    """Every floor pixel's depth is where its viewing ray meets z = 0, to the centimetre."""
    from edgemap.simulation.render.view import View
    from edgemap.simulation.world import CameraSetup

    setup = CameraSetup()
    x_m, y_m = drawn.apartment.plan.rooms[0].centre
    pose = SE2(x_m, y_m, 0.7)
    frame = renderer.frame(View.of_base(pose, setup.mount))
    rows, columns = np.mgrid[0:480:7, 0:640:7]
    rays = setup.intrinsics.rays(np.stack([columns.ravel(), rows.ravel()], axis=1))
    down = -(rays @ setup.mount.rotation_base_optical().T)[:, 2]
    below = down > 0.25
    expected = np.full(len(rays), np.nan)
    expected[below] = setup.mount.height_m / down[below]
    found, what = (values[rows.ravel(), columns.ravel()] for values in (frame.depth_m, frame.ids))
    # Where the ray meets the floor inside the room and no furniture is before it, it shows the floor (or the rug,
    # 6 mm higher).
    on_floor = pose.apply((rays * expected[:, None]) @ setup.mount.rotation_base_optical().T[:, :2] + [0.15, 0.0])
    room = drawn.apartment.plan.rooms[0]
    inside = ((on_floor > [room.x0 + 0.1, room.y0 + 0.1]) & (on_floor < [room.x1 - 0.1, room.y1 - 0.1])).all(axis=1)
    shown = below & inside & (what == 0)
    assert shown.sum() > 500
    assert np.abs(found - expected)[shown].max() < 0.006 / 0.25 + 0.005
    assert np.median(np.abs(found - expected)[shown]) < 0.01
