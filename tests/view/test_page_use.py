"""The page as people use it: on a phone, with the keyboard alone, with a screen reader (axe-core), light and dark."""

import json
import math

import msgspec
import numpy as np
import pytest
from support.axe import find_axe, serious_faults
from support.http_client import Api

from edgemap.cli.guessed_camera import CameraKeeper
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.intrinsics import Distortion, Intrinsics
from edgemap.geometry.camera.mount import Mount
from edgemap.runtime.inputs.drives.camera_yaml import read_camera_yaml

PHONE = {"width": 390, "height": 844}


def key(tab, name, count=1):
    """Press a key, as a person does."""
    codes = {"Enter": 13, "Tab": 9, "Backspace": 8, "ArrowUp": 38, "ArrowDown": 40, "ArrowLeft": 37, "ArrowRight": 39}
    text = {"Enter": "\r"}.get(name)
    for _ in range(count):
        more = {"text": text} if text else {}
        tab.call("Input.dispatchKeyEvent", type="keyDown", key=name, windowsVirtualKeyCode=codes[name], **more)
        tab.call("Input.dispatchKeyEvent", type="keyUp", key=name, windowsVirtualKeyCode=codes[name])


def tab_to(tab, identity):
    """Press Tab until an element has the focus."""
    for _ in range(60):
        if tab.value(f"document.activeElement.id === {identity!r}"):
            return
        key(tab, "Tab")
    raise AssertionError(f"{identity} is not reached with Tab")


def type_text(tab, text):
    tab.call("Input.insertText", text=text)


def test_on_a_phone_the_map_comes_first_and_the_rest_in_a_sheet(watched):
    _, tab = watched(12, **PHONE)
    _, top, right, bottom = tab.box("#map")
    assert top < 140
    assert right == 390
    assert bottom - top > 0.4 * 844
    assert tab.value("document.documentElement.scrollWidth") <= 390
    assert tab.value("document.documentElement.scrollHeight") <= 844
    assert tab.box("#sheet")[1] >= bottom - 1
    words = "document.getElementById('sheet-words').textContent"
    tab.until(f"{words} === '2 objects · nearest chair-1, 2.6 m'")
    heights = []
    for size in ("full", "peek", "half"):
        tab.click("sheet-handle")
        tab.until(f"edgemap.sheet.size === '{size}'")
        tab.until("document.getAnimations().length === 0")
        sheet = tab.box("#sheet")
        heights.append(sheet[3] - sheet[1])
        expanded = tab.value("document.getElementById('sheet-handle').getAttribute('aria-expanded')")
        assert expanded == str(size != "peek").lower()
    assert heights[1] < 60 < heights[2] < heights[0]


def test_on_a_phone_a_tap_on_an_object_shows_its_card(watched):
    _, tab = watched(12, **PHONE)
    tab.value("edgemap.sheet.show('peek')")
    tab.until("document.getAnimations().length === 0")
    tab.value("edgemap.map.tap(...edgemap.map.view.toScreen(4, -1.5))")
    tab.until("document.querySelector('#detail h2')?.textContent === 'couch-1'")
    tab.until("edgemap.sheet.size === 'half'")
    tab.until("document.getAnimations().length === 0")
    left, top, right, bottom = tab.box("#detail h2")
    assert 0 <= left < right <= 390
    assert 400 < top < bottom <= 844


def test_an_empty_map_says_what_to_do(serve, look):
    served = serve()
    tab = look(served)
    guide = "document.getElementById('guide')"
    tab.until(f"!{guide}.hidden && {guide}.textContent.startsWith('Waiting for the camera')")
    served.step()
    tab.until("edgemap.map.objects.size === 0 || edgemap.map.objects.size === 2")
    served.step(11)
    tab.until(f"edgemap.map.objects.size === 2 && {guide}.hidden")


def test_engineering_figures_are_folded_away_and_faults_open_them(watched):
    served, tab = watched(3)
    assert tab.value("document.getElementById('stages').checkVisibility()") is False
    served.fault("window odometry: 3 corners on the floor")
    tab.until("!document.getElementById('faults-link').hidden")
    tab.click("faults-link")
    assert tab.value("document.getElementById('faults').checkVisibility()") is True
    assert tab.value("document.getElementById('fault-count').textContent") == "1 fault"


def test_with_the_keyboard_alone_an_object_is_picked_corrected_and_merged(watched):
    served, tab = watched(12)
    tab.until("document.querySelectorAll('#objects li').length === 2")
    tab_to(tab, "map")
    tab.value("document.querySelector('#objects button').focus()")  # the list follows in the tab order
    key(tab, "Enter")
    tab.until("document.querySelector('#detail h2')?.textContent === 'chair-1'")
    tab.value("document.querySelector('.correct summary').focus()")
    key(tab, "Enter")
    tab.until("document.querySelector('.correct').open")
    tab.value("(i => { i.focus(); i.select(); })(document.querySelectorAll('.fields input')[1])")  # y
    type_text(tab, "0.25")
    key(tab, "Enter")
    tab.until("edgemap.map.objects.get('chair-1').y_m === 0.25")
    assert served.page.objects[0].corrected == ("position",)
    tab.value("document.querySelector('.merge select').focus()")
    key(tab, "ArrowDown")  # looks at what it would be; nothing is merged yet
    tab.until("!document.querySelector('.merge .preview').hidden")
    assert "Together: couch-1" in tab.value("document.querySelector('.merge .preview').textContent")
    assert len(served.page.objects) == 2
    key(tab, "Tab")
    assert tab.value("document.activeElement.textContent") == "Merge"
    key(tab, "Enter")
    tab.until("edgemap.map.objects.size === 1")


def test_with_the_keyboard_alone_a_zone_is_drawn(watched):
    """The cross in the middle of the map sets the corners; arrow keys move the floor below it."""
    served, tab = watched(12)
    tab.value("document.querySelector('#edit summary').focus()")
    key(tab, "Enter")
    tab.until("document.getElementById('edit').open")
    tab_to(tab, "draw")
    key(tab, "Enter")
    tab.until("edgemap.map.placing === 'zone'")
    assert tab.value("document.activeElement.id") == "map"
    corners = []
    for way in ("ArrowUp", "ArrowLeft", "ArrowDown"):
        key(tab, "Enter")
        corners.append(tab.value("edgemap.map.corners.at(-1)"))
        key(tab, way, 3)
    key(tab, "Enter")
    key(tab, "Backspace")
    tab.until("edgemap.map.corners.length === 3")
    tab.value("document.querySelector('#drawing input').focus()")
    type_text(tab, "hall")
    key(tab, "Enter")
    tab.until("document.querySelector('#zones .which')?.textContent.startsWith('hall')")
    (zone,) = served.page.annotations.zones
    np.testing.assert_allclose(zone.corners_m, corners, atol=1e-6)
    assert corners[1][0] > corners[0][0] + 0.5  # up is forward
    assert corners[2][1] > corners[1][1] + 0.5  # left is left


def test_a_tap_inside_a_room_offers_its_outline_as_a_zone(serve, look):
    served = serve(steps=11)
    served.sees_a_room()
    tab = look(served)
    tab.until("edgemap.map.objects.size === 2 && !edgemap.map.asked")
    tab.click("draw")
    tab.until("edgemap.map.placing === 'zone'")
    use = "[...document.querySelectorAll('#drawing button')].find(b => b.textContent === 'Use this room')"
    assert tab.value(f"{use}.hidden")
    tap = "edgemap.map.corners.splice(0, 9); edgemap.map.tap(...edgemap.map.view.toScreen(2.5, 1))"
    tab.until(f"(() => {{ {tap}; return !{use}.hidden; }})()")  # until the rooms have come
    tab.value(f"{use}.click()")
    tab.until("edgemap.map.corners.length >= 4")
    tab.value("document.querySelector('#drawing input').focus()")
    type_text(tab, "kitchen")
    key(tab, "Enter")
    tab.until("document.querySelector('#zones .which')?.textContent.startsWith('kitchen')")
    (zone,) = served.page.annotations.zones
    assert np.ptp(zone.corners_m, axis=0) == pytest.approx([3.0, 4.0], abs=0.25)


def test_the_robots_pose_and_the_dock_are_set_on_the_map(watched):
    served, tab = watched(12)
    press = "[...document.querySelectorAll('#drawing button')].find(b => b.textContent === '{}').click()".format
    tab.click("set-dock")
    for y_m in (1, 2):
        tab.value(f"edgemap.map.tap(...edgemap.map.view.toScreen(1, {y_m}))")
    tab.value(press("Set dock"))
    tab.until("edgemap.map.dock !== null")
    dock = served.page.annotations.dock
    assert dock.vector() == pytest.approx([1.0, 1.0, np.pi / 2], abs=0.02)
    tab.click("set-pose")
    inputs = "[...document.querySelectorAll('#drawing input')]"
    tab.value(f"(([x, y, yaw]) => {{ x.value = -1; y.value = 0.5; yaw.value = 180; }})({inputs})")
    tab.value(press("Set pose"))
    tab.until("document.getElementById('drawing').hidden")
    served.step()
    pose = Api(served.port).get("/api/pose")
    assert (pose["x_m"], pose["y_m"]) == (pytest.approx(-1.05, abs=0.1), pytest.approx(0.5, abs=0.1))


def test_an_object_is_added_on_the_map_and_drawn_in_its_shape(watched):
    served, tab = watched(12)
    tab.click("add")
    tab.value("document.querySelector('#drawing select').value = 'couch'")
    tab.value("edgemap.map.tap(...edgemap.map.view.toScreen(2, 2))")
    tab.value("[...document.querySelectorAll('#drawing button')].find(b => b.textContent === 'Add').click()")
    tab.until("edgemap.map.objects.has('couch-added-1')")
    assert tab.value("edgemap.map.objects.get('couch-added-1').footprint_m") == [2.0, 0.9]
    Api(served.port)("PATCH", "/api/objects/couch-added-1", {"yaw_rad": 0.0})  # facing forward
    tab.until("edgemap.map.objects.get('couch-added-1').yaw_rad === 0 && !edgemap.map.asked")
    filled = """((x, y) => { const map = document.getElementById('map'), ratio = map.width / map.clientWidth;
      const [left, top] = edgemap.map.view.toScreen(x, y);
      return map.getContext('2d').getImageData(Math.round(left * ratio), Math.round(top * ratio), 1, 1).data[3]; })"""
    assert tab.value(f"{filled}(2.2, 2.85)") > 0  # inside: 0.85 m to the left
    assert tab.value(f"{filled}(2.75, 2.1)") == 0  # 0.75 m ahead is outside of 0.9 m depth


BENT = Distortion("brown_conrady", (0.1, -0.02, 0.003, -0.002, 0.01))
CAMERA = FloorCamera(Intrinsics(320, 240, 293.0, 290.0, 159.5, 119.5, BENT), Mount.from_degrees(0.6, 11.5, 2.0, 0.1))


def laid(serve, look, folder, **options):
    """A page of a run as `edgemap run` opens it, its folder for a camera.yaml; a tab with the floor grid over it."""
    served, lens, mount = serve(steps=3), CAMERA.intrinsics, CAMERA.mount
    served.page.about |= {"lens": json.loads(msgspec.json.encode(lens)), "mount": {
        "height_m": mount.height_m, "pitch_deg": 11.5, "roll_deg": 2.0, "forward_m": 0.1, "left_m": 0.0,
    }}  # fmt: skip
    served.page.keep_mount = CameraKeeper(folder, CAMERA, None).set_mount
    tab = look(served, **options)
    tab.until("edgemap.frame === 2")
    tab.click("lay-grid")
    return served, tab


def test_the_floor_grid_is_dragged_until_it_lies_flat_and_saved(serve, look, tmp_path):
    served, tab = laid(serve, look, tmp_path)
    points = [[1.0, 0.5], [3.0, -1.0], [0.8, -0.4]]
    drawn = tab.value(f"{points}.map(([x, y]) => edgemap.grid.floor(x, y))")
    ahead = np.array(points) + [0.1, 0.0]  # the page counts from the lens
    np.testing.assert_allclose(drawn, CAMERA.project(ahead), atol=1e-6)
    served.step()
    tab.until("edgemap.updates > 3")
    assert tab.value("edgemap.frame") >= 2
    left, top, right, _ = tab.box("#picture")
    x, y, scale = (left + right) / 2, top + 20, (right - left) / 320
    move = {"button": "left", "buttons": 1, "clickCount": 1}
    tab.call("Input.dispatchMouseEvent", type="mousePressed", x=x, y=y, **move)
    tab.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y + 290 * scale * np.tan(np.radians(2.0)), **move)
    tab.until("Math.abs(edgemap.grid.mount.pitch_deg - 9.5) < 0.2")  # the horizon follows the pointer down
    tab.call("Input.dispatchMouseEvent", type="mouseReleased", x=x, y=y, **move)
    assert tab.value("edgemap.grid.mount.height_m") == pytest.approx(0.6, abs=1e-6)
    tab.value("edgemap.grid.sliders.height_m.focus()")
    key(tab, "ArrowRight", 3)
    key(tab, "Tab")
    key(tab, "ArrowRight", 4)
    pitch_deg = tab.value("edgemap.grid.mount.pitch_deg")
    assert tab.value("edgemap.grid.mount.height_m") == pytest.approx(0.63, abs=1e-6)
    key(tab, "Enter")
    tab.until("document.getElementById('notice').textContent.startsWith('Saved. The next run: --camera-file')")
    assert tab.value("document.getElementById('mount-form').hidden")
    kept = read_camera_yaml(tmp_path / "camera.yaml")
    assert kept.intrinsics == CAMERA.intrinsics
    assert (kept.mount.height_m, math.degrees(kept.mount.pitch_rad)) == pytest.approx((0.63, pitch_deg), abs=1e-6)
    assert (kept.mount.forward_m, math.degrees(kept.mount.roll_rad)) == pytest.approx((0.1, 2.0), abs=1e-6)
    shows = tab.value("edgemap.frame")
    served.step()
    tab.until(f"edgemap.frame > {shows} && edgemap.grid.open === false")


def test_a_grid_that_is_given_up_changes_nothing(serve, look, tmp_path):
    _, tab = laid(serve, look, tmp_path, **PHONE)
    tab.value("edgemap.grid.set({ pitch_deg: -40 })")
    tab.value("edgemap.grid.save()")
    tab.until("document.getElementById('notice').textContent.includes('looks at the sky')")
    tab.click("lay-grid")
    assert tab.value("edgemap.grid.mount.pitch_deg") == 11.5
    assert not (tmp_path / "camera.yaml").exists()


@pytest.mark.skipif(find_axe() is None, reason="no axe-core: npm install --no-save axe-core")
@pytest.mark.parametrize(("scheme", "size"), [("light", {}), ("dark", PHONE)])
def test_axe_finds_no_serious_fault_on_the_page(serve, look, scheme, size):
    served = serve(steps=12)
    api = Api(served.port)
    api("POST", "/api/zones", {"name": "hall", "corners_m": [[0, 0], [4, 0], [4, 3]]})
    served.fault("window odometry: 3 corners on the floor")
    tab = look(served, prefers_color_scheme=scheme, **size)
    tab.until("edgemap.map.objects.size === 2")
    assert serious_faults(tab) == []
    tab.value("document.querySelectorAll('details').forEach(fold => { fold.open = true; })")
    tab.value("document.querySelector('#objects button').click()")
    tab.until("!document.getElementById('detail').hidden")
    tab.value("document.querySelector('.correct').open = true; edgemap.sheet.show('full')")
    assert serious_faults(tab) == []
    tab.click("draw")
    assert serious_faults(tab) == []
    tab.click("lay-grid")
    assert serious_faults(tab) == []
