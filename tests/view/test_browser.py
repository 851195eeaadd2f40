"""The page in a real browser: Debian's chromium without a window. Frames are counted, never seconds."""

import json
from dataclasses import replace

import numpy as np
import pytest
from support.waiting import wait_for

from edgemap.geometry.se2 import SE2
from edgemap.runtime.outputs.verdict.causes import CAUSES
from edgemap.runtime.outputs.verdict.verdict import Finding, Verdict
from edgemap.runtime.step.map_file import save_map
from edgemap.view.viewer import IN_FLIGHT


def shows(tab, served, count=1):
    """Do steps, one at a time, each awaited on the screen."""
    for _ in range(count):
        served.step()
        tab.until(f"edgemap.frame === {served.steps.index - 1}")


# The most opaque of five pixels side by side: a line's middle, wherever it falls between two pixels.
COLOUR = """(canvas, left, top) => { const ratio = canvas.width / canvas.clientWidth;
  const { data } = canvas.getContext('2d').getImageData(Math.round(left * ratio) - 2, Math.round(top * ratio), 5, 1);
  return [0, 4, 8, 12, 16].map(i => [...data.slice(i, i + 4)]).sort((a, b) => b[3] - a[3])[0]; }"""


def test_it_shows_what_the_robot_sees_and_asks_nobody_else(watched):
    served, tab = watched(5)
    tab.until("document.querySelectorAll('#objects li').length === 2")
    assert tab.value("[...document.querySelectorAll('#objects li')].map(li => li.dataset.id)") == ["chair-1", "couch-1"]
    caption = tab.value("document.getElementById('caption').textContent")
    assert caption == "frame 5 of 100, 0.4 s3 in view, 2 on the floor; metres from the robot"
    assert tab.value("document.getElementById('state').textContent") == "running"
    stages = tab.value("[...document.querySelectorAll('#stages th')].map(cell => cell.textContent)")
    assert stages == ["preprocess", "backbone", "closure", "map", "grid", "relocalisation"]
    # The chair's box: 40..90 px of a picture 320 wide. Its left edge halfway down has the chair's colour.
    scale = tab.value("document.getElementById('picture').clientWidth") / 320
    pixel = tab.value(f"({COLOUR})(document.getElementById('boxes'), {40 * scale}, {110 * scale})")
    assert pixel == pytest.approx([0x00, 0x72, 0xB2, 255], abs=12)
    asked = {event["request"]["url"] for event in tab.said("Network.requestWillBeSent")}
    assert len(asked) >= 12
    assert all(url.startswith((served.url, "blob:", "data:")) for url in asked), asked
    assert tab.said("Runtime.exceptionThrown", "Log.entryAdded", "Runtime.consoleAPICalled") == []


def test_on_the_map_forward_is_up_and_left_is_left(watched):
    """The chair stands at x 3 m ahead, y 1 m to the left; the couch at x 4 m, y 1.5 m to the right."""
    _, tab = watched(5)
    left, top = tab.value("edgemap.map.view.toScreen(...edgemap.map.pose)")
    metre = tab.value("edgemap.map.view.now.scale")
    place = "(({{x_m, y_m}}) => edgemap.map.view.toScreen(x_m, y_m))(edgemap.map.objects.get('{}'))".format
    at = {name: tab.value(place(name)) for name in ("chair-1", "couch-1")}
    assert at["chair-1"] == pytest.approx((left - metre, top - 2.8 * metre), abs=0.05 * metre)
    assert at["couch-1"] == pytest.approx((left + 1.5 * metre, top - 3.8 * metre), abs=0.05 * metre)
    for name, colour in (("chair-1", [0x00, 0x72, 0xB2]), ("couch-1", [0xC7, 0x77, 0x00])):
        pixel = tab.value(f"({COLOUR})(document.getElementById('map'), {at[name][0]}, {at[name][1]})")
        assert pixel == pytest.approx([*colour, 255], abs=12)


def test_a_hidden_tab_gets_nothing_until_it_is_seen_again(serve, look, browser):
    served = serve()
    tab = look(served)
    shows(tab, served, 2)
    cover = browser.open("about:blank", new_window=False)
    browser.call("Target.activateTarget", targetId=cover.target)
    tab.until("document.hidden")
    shows_before = tab.value("edgemap.drawn")
    second = look(served, new_window=True)
    received = tab.value("edgemap.updates")
    for _ in range(8):
        shows(second, served)
        tab.value("edgemap.connection.shown()")  # even though it has room for more
    assert tab.value("edgemap.updates") - received <= IN_FLIGHT
    assert tab.value("edgemap.drawn") == shows_before
    browser.call("Target.activateTarget", targetId=tab.target)
    tab.until("edgemap.frame === 9")
    cover.close()


def test_it_comes_back_by_itself_after_the_robot_was_restarted(serve, look):
    first = serve(steps=5)
    tab = look(first)
    tab.until("edgemap.frame === 4")
    tab.click("sightings")
    first.server.close()
    tab.until("edgemap.state === 'lost'")
    assert "Trying again" in tab.value("document.getElementById('headline').textContent")
    second = serve(port=first.port)
    tab.until("edgemap.state === 'running'")
    assert tab.value("edgemap.map.objects.size + edgemap.map.trail.length") == 0  # the old run's map is gone
    shows(tab, second, 3)
    assert tab.value("edgemap.map.trail.length") == 3
    tab.until("edgemap.map.sightings.length === 6")  # still wanted


def test_pause_holds_the_run_for_all_and_resumes(serve, look):
    served = serve(steps=2)
    one, other = look(served), look(served)
    one.click("pause")
    other.until("edgemap.state === 'paused'")
    assert served.page.pause.paused
    assert other.value("document.getElementById('pause').textContent") == "Resume"
    other.click("pause")
    one.until("edgemap.state === 'running'")
    assert not served.page.pause.paused


def test_of_a_live_camera_pause_holds_the_page_only(serve, look):
    served = serve(live=True)
    tab, other = look(served), look(served)
    shows(tab, served)
    tab.click("pause")
    tab.until("edgemap.state === 'held'")
    shows(other, served, 5)
    assert tab.value("edgemap.frame") == 0
    assert other.value("edgemap.state") == "running"
    tab.click("pause")
    tab.until("edgemap.frame === 5 && edgemap.state === 'running'")


def test_the_download_is_map_json_and_saving_keeps_a_copy(watched, tmp_path):
    served, tab = watched(12)
    save_map(tmp_path / "map.json", served.page.objects, served.page.annotations)
    assert tab.value("document.getElementById('download').download") == "map.json"
    got = tab.value("fetch(document.getElementById('download').href).then((answer) => answer.text())")
    saved = json.loads((tmp_path / "map.json").read_text())
    assert json.loads(got).items() <= saved.items()  # but for when it was saved
    tab.click("save")
    tab.until("!document.getElementById('notice').hidden")
    assert json.loads(got).items() <= json.loads((tmp_path / "map-000011.json").read_text()).items()


def test_sightings_come_and_go_and_faults_appear(watched):
    served, tab = watched(6)
    for _ in range(2):
        tab.click("sightings")
        tab.until("edgemap.map.sightings.length === 12")
        tab.click("sightings")
        tab.until("edgemap.map.sightings.length === 0")
    served.fault("window odometry: 3 corners on the floor")
    tab.until("document.querySelector('#faults li')?.firstChild.textContent === 'frame 7'")
    words = tab.value("document.getElementById('faults').textContent")
    remedy = CAUSES["drift"].remedy.replace("`", "")
    assert words == f"frame 7window odometry: 3 corners on the floor{remedy}"
    served.page.close()
    tab.until("edgemap.state === 'finished'")
    assert tab.value("document.getElementById('pause').disabled")


def test_on_a_phone_buttons_are_tall_and_two_fingers_zoom(watched):
    _, tab = watched(5, width=390, height=844)
    tall = "[...document.querySelectorAll('button, .button')].filter(b => b.checkVisibility()).map(b => b.offsetHeight)"
    assert tab.value(f"Math.min(...{tall})") >= 34
    tab.value("document.getElementById('map').scrollIntoView()")
    left, top, before = (
        tab.value("""(() => { const {left, top, width, height} = document.getElementById('map').getBoundingClientRect();
        return [left + width / 2, top + height / 2, edgemap.map.view.now.scale]; })()""")
    )

    def touch(kind, *reach):
        points = [{"x": left + sign * way, "y": top, "id": row} for way in reach for row, sign in enumerate((-1, 1))]
        tab.call("Input.dispatchTouchEvent", type=kind, touchPoints=points)

    tab.call("Emulation.setTouchEmulationEnabled", enabled=True, maxTouchPoints=2)
    touch("touchStart", 30)
    touch("touchMove", 45)
    touch("touchMove", 60)
    touch("touchEnd")
    tab.until("edgemap.map.view.mode === 'free'")
    assert tab.value("edgemap.map.view.now.scale") == pytest.approx(2 * before, rel=0.05)


def test_nothing_is_cut_or_lies_over_another_on_small_and_enlarged_screens(watched):
    """A phone held sideways, a laptop at 200 %, and a phone."""
    _, tab = watched(5)
    cut = """[...document.querySelectorAll('.tools button, .actions > *, #figures .big')]
      .filter(element => element.checkVisibility()).filter(element => {
      const inner = document.createRange(); inner.selectNodeContents(element);
      const own = inner.getBoundingClientRect(), card = element.closest('.card, header').getBoundingClientRect();
      return own.left < card.left || own.right > card.right; }).map(element => element.textContent)"""
    over = """(() => { const boxes = [...document.querySelectorAll('#figures .big')].map(element => {
      const inner = document.createRange(); inner.selectNodeContents(element); return inner.getBoundingClientRect(); });
      return boxes.flatMap((a, i) => boxes.slice(i + 1).filter(b => a.left < b.right - 1 && b.left < a.right - 1
        && a.top < b.bottom - 1 && b.top < a.bottom - 1)).length; })()"""
    tab.value("document.getElementById('diagnostics').open = true")
    for width, height, scale in ((844, 390, 1.0), (640, 400, 2.0), (390, 844, 1.0)):
        tab.resize(width, height, scale)
        tab.until(f"innerWidth === {width}")
        assert tab.value("document.documentElement.scrollWidth") <= width
        if height < 500:  # picture and map are seen at once
            for name in (".picture", ".map"):
                left, top, right, bottom = tab.box(name)
                assert 0 <= top <= bottom - 200 <= height - 200, (name, top, bottom)
                assert right - left >= 200, name
        tab.value("document.querySelectorAll('#figures .big').forEach(text => text.firstChild.textContent = '1234.5')")
        assert tab.value(cut) == []
        assert tab.value(over) == 0


def test_the_mouse_drags_the_floor_and_the_wheel_zooms_about_the_pointer(watched):
    _, tab = watched(5)
    box = tab.value("(({left, top}) => [left, top])(document.getElementById('map').getBoundingClientRect())")
    under = "edgemap.map.view.toFloor({}, {})".format

    def mouse(kind, x, y, **more):
        tab.call("Input.dispatchMouseEvent", type=kind, x=box[0] + x, y=box[1] + y, **more)

    held = tab.value(under(200, 300))
    mouse("mousePressed", 200, 300, button="left", clickCount=1)
    mouse("mouseMoved", 260, 350, button="left", buttons=1)
    mouse("mouseReleased", 260, 350, button="left")
    tab.until("edgemap.map.view.mode === 'free'")
    assert tab.value(under(260, 350)) == pytest.approx(held, abs=0.02)
    held, scale = tab.value(under(400, 250)), tab.value("edgemap.map.view.now.scale")
    mouse("mouseWheel", 400, 250, deltaX=0, deltaY=-200)
    tab.until(f"edgemap.map.view.now.scale > {1.2 * scale}")
    assert tab.value(under(400, 250)) == pytest.approx(held, abs=0.02)
    tab.click("fit")
    tab.until(f"Math.abs(edgemap.map.view.now.scale - {scale}) < 1")


def test_what_is_wrong_stands_first_in_words(watched):
    """The worst as the headline, the rest below it, above everything else on the page."""
    served, tab = watched(3)
    headline = "document.getElementById('headline').textContent"
    wait_for(lambda: served.step() or tab.value(f"{headline}.startsWith('Running')"), "a run without problems")
    assert tab.value("document.getElementById('status').dataset.level") == "ok"
    served.page.camera_state = lambda: "lost"
    served.fault("window odometry: 3 corners on the floor")
    tab.until(f"{headline} === 'The camera is lost. The map so far is saved.'")
    problems = tab.value("[...document.querySelectorAll('#problems li')].map(li => li.textContent)")
    assert problems == ["Odometry: window odometry: 3 corners on the floor."]
    assert tab.value("document.getElementById('status').dataset.level") == "fault"
    assert tab.value("document.getElementById('status').getBoundingClientRect().top") == 0
    assert tab.value("document.body.firstElementChild.id") == "status"


MAP_CLICK = """(([left, top]) => { const map = document.getElementById('map'), box = map.getBoundingClientRect();
  return [box.left + left, box.top + top]; })"""


def tap(tab, left, top):
    for kind in ("mousePressed", "mouseReleased"):
        tab.call("Input.dispatchMouseEvent", type=kind, x=left, y=top, button="left", clickCount=1)


def test_an_object_is_picked_on_the_map_and_in_the_list(serve, look):
    served = serve(steps=12)
    served.page.crops.consider(served.page.newest.result)
    tab = look(served)
    tab.until("edgemap.frame === 11 && document.querySelectorAll('#objects li').length === 2 && !edgemap.map.asked")
    tap(tab, *tab.value(f"{MAP_CLICK}(edgemap.map.view.toScreen(4, -1.5))"))
    tab.until("document.querySelector('#detail h2')?.textContent === 'couch-1'")
    detail = tab.value("document.getElementById('detail').innerText")
    for text in ("From the robot", "3.7", "Confidence", "12 times, in view", "couch", "100 %"):
        assert text in detail, detail
    tab.until("document.querySelector('#detail img').naturalWidth > 0")  # its picture
    assert tab.value("edgemap.map.view.mode") == "fit"  # it was in sight
    tab.value("document.querySelector('#objects button').click()")
    tab.until("document.querySelector('#detail h2').textContent === 'chair-1'")
    assert tab.value("document.querySelector('#objects button').getAttribute('aria-pressed')") == "true"
    tap(tab, *tab.value(f"{MAP_CLICK}(edgemap.map.view.toScreen(1, 1))"))  # the bare floor
    tab.until("document.getElementById('detail').hidden")


def test_the_list_is_by_distance_from_the_robot(watched):
    served, tab = watched(12)
    texts = "li.querySelector('.who').textContent + li.querySelector('.far').textContent"
    rows = f"[...document.querySelectorAll('#objects li')].map(li => {texts})"
    tab.until(f"{rows}.join() === 'chair-12.6 m,couch-13.8 m'")
    result, objects = served.steps.next()
    moved = replace(result, pose_map_base=SE2(4.0, -1.0, 0.0))
    served.page.write(moved, objects)
    tab.until(f"{rows}.join() === 'couch-10.5 m,chair-12.2 m'")


def test_fit_shows_all_of_a_large_map(serve, look):
    """Ellipses and the far ends of a map 300 m long are inside; below the buttons, above the scale."""
    served = serve(steps=12)
    result, objects = served.steps.next()
    places = (300.0, 20.0), (-5.0, -80.0)
    far = [replace(objects[0], id=f"chair-{n}", position_m=np.array(at)) for n, at in enumerate(places, 5)]
    served.page.write(result, [*objects, *far])
    for width, height in ((1440, 900), (390, 844)):
        tab = look(served, width=width, height=height)
        tab.until("edgemap.map.objects.size === 4")
        away = "(({now, goal}) => Math.abs(goal.x - now.x) + Math.abs(goal.y - now.y) < .1 && now.scale < 5)"
        tab.until(f"{away}(edgemap.map.view)")
        size = tab.value("(map => [map.clientWidth, map.clientHeight])(document.getElementById('map'))")
        for at in (*places, (0.0, 0.0)):
            left, top = tab.value(f"edgemap.map.view.toScreen({at[0]}, {at[1]})")
            assert 20 <= left <= size[0] - 20, at
            assert 50 <= top <= size[1] - 30, at
        assert tab.value("document.documentElement.scrollWidth") <= width


def pick(tab, identity):
    tab.until(f"document.querySelector('#objects li[data-id={identity}]')")
    tab.value(f"document.querySelector('#objects li[data-id={identity}] button').click()")
    tab.until(f"edgemap.map.chosen === '{identity}'")


def press(tab, text, within="#detail"):
    """Click the button that says so."""
    found = f"[...document.querySelectorAll('{within} button')].find(b => b.textContent === '{text}')"
    tab.until(found)
    tab.value(f"{found}.click()")


def test_an_object_is_named_confirmed_merged_and_deleted_and_all_is_taken_back(serve, look):
    served = serve(steps=12)
    tab, other = look(served), look(served)
    names = "[...document.querySelectorAll('#objects .who')].map(who => who.textContent).join()"
    hostile = '<img src=x onerror=window.hurt=1> & "Zoë\'s"'
    pick(tab, "chair-1")
    tab.value(f"document.querySelector('#detail input').value = {json.dumps(hostile)}")
    press(tab, "Rename")
    for page in (tab, other):  # typed by one person, seen by all, as text
        page.until(f"{names} === {json.dumps(hostile + ',couch-1')}")
        assert page.value("window.hurt") is None
        assert page.value("document.querySelectorAll('#objects img, #detail h2 img').length") == 0
    press(tab, "Confirm")
    tab.until("document.querySelector('#objects li .more').textContent.includes('chair-1, confirmed')")
    tab.value("document.querySelector('#detail input').value = 'a\\u202eb'")
    press(tab, "Rename")  # what the robot refuses is told in its words
    tab.until("document.getElementById('notice').textContent.includes('name')")
    pick(tab, "couch-1")
    tab.value("""(() => { const list = document.querySelector('#detail select'); list.value = 'chair-1';
        list.dispatchEvent(new Event('change')); })()""")
    tab.until("!document.querySelector('#detail .preview').hidden")
    press(tab, "Merge")
    other.until("edgemap.map.objects.size === 1 && edgemap.map.objects.get('chair-1').count === 24")
    press(tab, "Undo", "#notice")
    other.until("edgemap.map.objects.size === 2")
    pick(tab, "couch-1")
    press(tab, "Delete")
    other.until("edgemap.map.objects.size === 1")
    tab.until("document.getElementById('detail').hidden")
    press(tab, "Undo", "#notice")
    tab.until("edgemap.map.objects.size === 2")
    saved = {item.id: (item.name, item.confirmed) for item in served.page.objects}
    assert saved == {"chair-1": (hostile, True), "couch-1": ("", False)}


def test_a_zone_is_drawn_with_taps_named_and_deleted(watched):
    served, tab = watched(12)
    tab.value("document.getElementById('legend').open = false")  # the map takes its room
    tab.until("edgemap.map.canvas.width === edgemap.map.canvas.parentElement.clientWidth && !edgemap.map.asked")
    tab.click("draw")
    for x, y in ((2.2, 2.0), (2.2, 0.2), (3.8, 0.2), (3.8, 2.0)):
        tap(tab, *tab.value(f"{MAP_CLICK}(edgemap.map.view.toScreen({x}, {y}))"))
    tab.until("edgemap.map.corners.length === 4")
    assert tab.value("document.querySelector('#drawing button:last-child').disabled")  # it has no name yet
    tab.value("""(() => { const name = document.querySelector('#drawing input'); name.value = '<b>hall</b>';
        name.dispatchEvent(new Event('input')); })()""")
    press(tab, "Save zone", "#drawing")
    tab.until("document.querySelector('#zones .which')?.textContent === '<b>hall</b> chair-1'")
    (zone,) = served.page.annotations.zones
    np.testing.assert_allclose(zone.corners_m, [(2.2, 2.0), (2.2, 0.2), (3.8, 0.2), (3.8, 2.0)], atol=0.03)
    assert tab.value("edgemap.map.chosen") is None  # drawing picks nothing
    press(tab, "Delete", "#zones")
    tab.until("document.getElementById('zones').hidden")
    press(tab, "Undo", "#notice")
    tab.until("!document.getElementById('zones').hidden")
    assert [zone.name for zone in served.page.annotations.zones] == ["<b>hall</b>"]


def test_how_far_the_map_can_be_trusted_stands_on_the_page_while_it_grows(serve, look):
    served = serve()
    guess = Finding("care", CAUSES["guess"], "the lens is guessed")
    verdict = Verdict("unreliable", (guess, Finding("unreliable", CAUSES["light"], "33 % dark")))
    served.page.verdict = lambda: verdict
    served.step(3)
    tab = look(served)
    trust = "document.getElementById('trust')"
    tab.until(f"{trust}.textContent === 'map so far: not reliable (the lens is guessed; 33 % dark)'")
    served.page.verdict = lambda: Verdict("good")
    served.step()
    tab.until(f"{trust}.textContent === 'map so far: good' && !{trust}.hidden")
    served.page.close()
    tab.until(f"{trust}.hidden && document.getElementById('headline').textContent === 'The run is over. Map: good.'")
