"""Rendered pictures against edgemap.geometry: boxes, shares, lenses, depths; the demo has enough to map."""

import json
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from edgemap.geometry.camera.intrinsics import Distortion, Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.errors import EdgemapError
from edgemap.geometry.se2 import SE2
from edgemap.runtime.inputs import demo
from edgemap.simulation.render.mesh import Material, box, placed, quad
from edgemap.simulation.render.movers import Mover
from edgemap.simulation.render.renderer import Renderer
from edgemap.simulation.render.scene import LightMix, LitPart, LitScene, LitSurface, Probes, Surface
from edgemap.simulation.render.view import View
from edgemap.simulation.truth import picture_boxes

INTRINSICS = Intrinsics(320, 240, 200.0, 200.0, 159.5, 119.5)
# Looks along x from (0, 0, 1).
MOUNT = Mount.from_degrees(1.0, 0.0)
GREY = Material((0.5, 0.5, 0.5))
PROBES = Probes(np.zeros(3), np.ones(3), np.full((1, 1, 1, 6, 6), 0.2, np.float32))


def light(shape, lamp, day):
    return np.broadcast_to(np.repeat(np.float32([lamp, day]), 3), (*shape, 6))


def lit(id_, mesh, lamp=1.0, day=0.0):
    return [LitPart(id_, p, *[light(p.positions.shape[:2], lamp, day)] * 2) for p in mesh]


def sheet(x, y0, y1, z0, z1, material=GREY):
    """A rectangle across the view, facing the camera."""
    return [quad((x, y0, z0), (0, 0, z1 - z0), (0, y1 - y0, 0), material)]


def wall(x, half, lamp=1.0, day=0.0):
    surface = Surface(np.array([x, half, 1 - half]), np.array([0, -2.0 * half, 0]), np.array([0, 0, 2.0 * half]), GREY)
    return LitSurface(surface, light((4, 4), lamp, day))


@pytest.fixture
def draw():
    """Makes a renderer of parts and surfaces; closed at the end."""
    with ExitStack() as made:

        def make(parts, surfaces=(), intrinsics=INTRINSICS):
            try:
                scene = LitScene(tuple(surfaces), tuple(parts), (), PROBES)
                return made.enter_context(closing(Renderer(scene, intrinsics)))
            except EdgemapError as error:
                pytest.skip(str(error))

        yield make


@pytest.fixture
def view():
    return View.of_base(SE2(0.0, 0.0, 0.0), MOUNT)


def boxes(renderer, view, labels, movers=()):
    items = tuple(SimpleNamespace(id=id_, label=label) for id_, label in labels.items())
    apartment: Any = SimpleNamespace(furniture=items)
    records = picture_boxes(renderer, renderer.frame(view, movers=movers), view, apartment, movers)
    return {record["id"]: record for record in records}


def test_hidden_half_shows_in_the_box_and_the_share(draw, view):
    """At 2 m 0.4 m are 40 px: columns 139.5 to 179.5 of pixel centres, so pixels 140..179. The near sheet hides all
    to the left of y = 0, i.e. columns up to 159."""
    far, near = sheet(2.0, -0.2, 0.2, 0.8, 1.2), sheet(1.0, 0.0, 0.5, 0.5, 1.5)
    found = boxes(draw([*lit(1, far), *lit(2, near)]), view, {1: "chair", 2: "couch"})
    assert found[1]["box"] == [160, 100, 180, 140]
    assert found[1]["full_box"] == [140, 100, 180, 140]
    assert found[1]["visible"] == pytest.approx(0.5, abs=0.01)
    assert found[2]["box"] == found[2]["full_box"] == [60, 20, 160, 220]
    assert found[2]["visible"] == pytest.approx(1.0, abs=0.01)


def test_what_the_border_cuts_counts_as_hidden(draw, view):
    """0.8 m wide at 1 m: 160 px, half of them beyond the left border (column 0 is at y = 0.8)."""
    found = boxes(draw(lit(1, sheet(1.0, 0.4, 1.2, 0.9, 1.1))), view, {1: "chair"})
    assert found[1]["box"] == found[1]["full_box"] == [0, 100, 80, 140]
    assert found[1]["visible"] == pytest.approx(0.5, abs=0.01)


def test_objects_that_reach_behind_the_camera_have_a_whole_box(draw, view):
    found = boxes(draw(lit(1, box((-1.0, -1.0, 0.2), (3.0, -0.5, 0.4), GREY))), view, {1: "bed"})
    assert found[1]["full_box"][2:] == [320, 240]
    # Its far left edge: y = -0.5 at x = 3.
    assert found[1]["full_box"][0] == pytest.approx(160 + 200 * 0.5 / 3.0, abs=1)


@pytest.mark.parametrize("mix", [LightMix(1.0, 1.0), LightMix(0.5, 0.0), LightMix(0.0, 0.25)])
def test_groups_of_light_add_up(draw, view, mix):
    """A matte grey at light L shows ACES(0.5 L), on corners and on light maps alike."""
    renderer = draw(lit(1, sheet(1.5, -0.3, 0.0, 0.8, 1.2), 0.6, 0.2), [wall(2.0, 1.5, 0.6, 0.2)])
    picture = renderer.frame(view, mix).picture
    x = 0.5 * (0.6 * mix.lamp + 0.2 * mix.day)
    shown = 255 * (x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14)) ** (1 / 2.2)
    assert np.abs(picture[120, 180].astype(float) - shown).max() < 2.5
    assert np.abs(picture[120, 100].astype(float) - shown).max() < 2.5


def test_glass_shows_what_is_behind_but_is_an_object(draw, view):
    glass = replace(GREY, colour=(0.0, 0.0, 0.0), opacity=0.5)
    renderer = draw(lit(1, sheet(1.5, -0.3, 0.3, 0.8, 1.2, glass)), [wall(2.0, 1.5)])
    frame = renderer.frame(view)
    assert frame.ids[120, 160] == 1
    assert frame.depth_m[120, 160] == pytest.approx(1.5, abs=1e-3)
    assert 0.2 < frame.picture[120, 160, 0] / frame.picture[120, 40, 0] < 0.8
    assert frame.ids[120, 40] == 0


POSE = SE2(1.0, 2.0, 0.4)
TILTED = Mount.from_degrees(0.55, 14.0, roll_deg=6.0, forward_m=0.2, left_m=-0.07)
# Nothing square, nothing centred: every sign and offset must be right.
UNEVEN = Intrinsics(320, 240, 210.0, 190.0, 150.3, 128.9)
BENT = replace(UNEVEN, distortion=Distortion("brown_conrady", (-0.25, 0.08, 0.002, -0.003, 0.0)))


@pytest.mark.parametrize("lens", [UNEVEN, BENT], ids=["pinhole", "bent"])
def test_points_stand_where_mount_and_lens_project_them(draw, lens):
    """Small sheets all over the picture, in ids, colour and depth; where they stand is written from the mount alone,
    apart from View, and nothing on a round number, so that no edge runs along pixel centres."""
    y, z = (values.ravel() for values in np.meshgrid(np.linspace(-1.413, 1.387, 7), np.linspace(-0.889, 0.911, 5)))
    half, parts = 0.0313, []
    for n, (left, up) in enumerate(zip(y, z, strict=True), 1):
        marker = sheet(2.0, left - half, left + half, up - half, up + half)
        parts += lit(n, placed(marker, POSE, 0.0))
    frame = draw(parts, intrinsics=lens).frame(View.of_base(POSE, TILTED))
    from_lens = np.column_stack([np.full(len(y), 2.0), y, z]) - TILTED.position_base_m()
    optical = from_lens @ TILTED.rotation_base_optical()
    expected = lens.project(optical)
    inside = (expected > 8).all(axis=1) & (expected < [310, 230]).all(axis=1)
    assert inside.sum() > 12
    bright = frame.picture[..., 0].astype(float) ** 2.2
    for n in np.flatnonzero(inside) + 1:
        rows, columns = np.nonzero(frame.ids == n)
        u, v = expected[n - 1]
        assert np.hypot(columns.mean() - u, rows.mean() - v) < 0.5
        near = np.s_[int(v) - 6 : int(v) + 8, int(u) - 6 : int(u) + 8]
        r, c = np.mgrid[near]
        weight = bright[near]
        assert np.hypot((c * weight).sum() / weight.sum() - u, (r * weight).sum() / weight.sum() - v) < 0.2
        assert np.median(frame.depth_m[rows, columns]) == pytest.approx(optical[n - 1, 2], abs=0.01)


def test_movers_stand_where_they_are_put(draw, view):
    renderer = draw(lit(1, sheet(4.0, -0.3, 0.3, 0.7, 1.3)), [wall(6.0, 3.0)])
    mesh = box((-0.1, -0.2, 0.0), (0.1, 0.2, 1.8), GREY)
    mover = Mover(10_000, mesh, SE2(2.0, 0.3, np.pi / 2))
    empty = renderer.frame(view)
    found = boxes(renderer, view, {1: "tv"}, (mover,))
    # Turned a quarter, its front face is 0.2 m wide, 1.8 m ahead; its top is 0.8 m above the camera.
    u0, u1 = 160 - 200 * 0.4 / 1.8, 160 - 200 * 0.2 / 2.2
    assert found[10_000]["label"] == "person"
    assert found[10_000]["full_box"] == pytest.approx([u0, 120 - 200 * 0.8 / 1.8, u1, 120 + 200 * 1.0 / 1.8], abs=1.01)
    assert found[1]["visible"] == pytest.approx(1.0, abs=0.02)
    moved = renderer.frame(view, movers=(replace(mover, pose_home_mover=SE2(2.0, 0.0, 0.0)),))
    assert moved.ids[120, 160] == 10_000
    assert moved.depth_m[120, 160] == pytest.approx(1.9, abs=1e-3)
    assert boxes(renderer, view, {1: "tv"})
    assert (renderer.frame(view).picture == empty.picture).all()


FOLDER = Path(demo.__file__).parent


def test_enough_to_map_and_light_enough_to_ship():
    objects = json.loads((FOLDER / "objects.json").read_text())["objects"]
    scorable = [o for o in objects if o["on_floor"] and o["visible_frames"] >= 10]
    assert len(scorable) >= 8
    assert len({o["label"] for o in scorable}) >= 4
    assert sum(path.stat().st_size for path in FOLDER.iterdir() if path.is_file()) < 8_000_000


def test_every_model_is_credited(furniture_catalogue):
    text = (FOLDER / "README.md").read_text()
    keys = [line.split("`")[1] for line in text.splitlines() if line.startswith("| ") and "`" in line]
    assert len(keys) > 8
    for key in keys:
        assert furniture_catalogue[key].creator in text
