"""The server as any program meets it: who is let in, what is sent, and what a slow or rude viewer does to others."""

import socket
import threading
from contextlib import ExitStack, suppress
from dataclasses import replace

import pytest
import uvicorn
from support.http_client import Api
from support.live import raw_viewer
from support.waiting import wait_for
from uvicorn.protocols.http.h11_impl import H11Protocol
from websockets.exceptions import ConnectionClosed, InvalidStatus

from edgemap.geometry.objects.events import Edit
from edgemap.geometry.se2 import SE2
from edgemap.runtime.frames.faults import Fault, FaultKind
from edgemap.view.app import MAXIMUM_VIEWERS
from edgemap.view.guard import cookie_value
from edgemap.view.server import PageServer, ViewError, WaitingLimited
from edgemap.view.viewer import IN_FLIGHT


def ask(port, path="/", method="GET", **headers):
    """Status, headers and body of one request; headers as given, with - for _."""
    return Api(port)(method, path, **headers)


def test_the_page_names_nothing_from_elsewhere(serve):
    served = serve()
    for name in ("", "style.css", "main.js", "map.js", "picture.js", "connection.js", "panels.js", "viewport.js"):
        status, headers, text = ask(served.port, f"/{name}")
        assert status == 200
        assert "default-src 'self'" in headers["content-security-policy"]
        assert b"http://" not in text
        assert b"https://" not in text
    assert ask(served.port, "/../page.py")[0] == 404
    assert ask(served.port, "/api/map", "POST")[0] == 405
    for path, method, status in (("/api/nothing", "GET", 404), ("/api/map", "DELETE", 405), ("/api/", "GET", 404)):
        found, headers, body = ask(served.port, path, method)
        assert (found, headers["content-type"]) == (status, "application/json")
        assert body == {"error": f"{method} '{path}' is not in this API"}


def test_a_name_that_was_made_to_point_here_is_refused(serve):
    port = serve().port
    foreign = ["evil.example", "evil.example:80", "127.0.0.1.evil.example", "", "[::1", f"localhost.evil:{port}"]
    # What comes back in the page's own headers is a name and a port, nothing else.
    foreign += [
        f"x@127.0.0.1:{port}", f"127.0.0.1:{port}/;script-src *", "127.0.0.1 evil.example", "localhost:80x", "[]",
    ]  # fmt: skip
    for host in foreign:
        assert ask(port, Host=host)[0] == 400, host
    for host in (f"127.0.0.1:{port}", f"localhost:{port}", f"[::1]:{port}", "localhost:9000"):  # 9000: a tunnel's port
        assert ask(port, Host=host)[0] == 200, host


def test_another_sites_script_gets_neither_map_nor_socket(serve):
    port = serve().port
    for origin in ("https://evil.example", "null", "http://127.0.0.1:1", "http://localhost", "http://[", "//", "x"):
        status, _, text = ask(port, "/api/map", Origin=origin)
        assert (status, text) == (403, {"error": "requests from other sites are refused"})
        assert ask(port, "/api/pause", "POST", Origin=origin)[0] == 403
        with pytest.raises(InvalidStatus, match="403"), raw_viewer(port, origin=origin):
            pass
    own = f"http://127.0.0.1:{port}"
    assert ask(port, "/api/map", Origin=own)[0] == 200
    with raw_viewer(port, origin=own) as viewer:
        assert viewer.hello["camera"] == "made"


@pytest.mark.parametrize("site", ["cross-site", "same-site"])
def test_another_sites_picture_of_the_page_stays_empty(serve, site):
    served = serve(steps=1)
    asked = {"Sec-Fetch-Site": site, "Sec-Fetch-Mode": "no-cors", "Sec-Fetch-Dest": "image"}
    assert ask(served.port, "/api/picture", **asked)[0] == 403
    assert ask(served.port, "/", **asked | {"Sec-Fetch-Dest": "iframe", "Sec-Fetch-Mode": "navigate"})[0] == 403
    followed = {"Sec-Fetch-Site": site, "Sec-Fetch-Mode": "navigate", "Sec-Fetch-Dest": "document"}
    assert ask(served.port, "/", **followed)[0] == 200
    assert ask(served.port, "/api/picture", **followed)[0] == 403
    status, headers, _ = ask(served.port, "/api/pose", **asked | {"Sec-Fetch-Site": "same-origin"})
    assert (status, headers["cross-origin-resource-policy"]) == (200, "same-origin")


def test_an_address_that_is_not_ascii_is_refused(serve):
    port = serve().port
    for target in ("/?a=\xff", "/nothing?a=\xc3", "/api/map?\xe9", "/\xff"):
        with socket.create_connection(("127.0.0.1", port), timeout=60) as raw:
            raw.sendall(f"GET {target} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode("latin-1"))
            assert raw.recv(100).startswith(b"HTTP/1.1 400")


def test_beyond_loopback_nothing_comes_without_the_token(serve):
    served = serve(host="0.0.0.0")
    port, token = served.port, served.token
    assert len(token) >= 20
    assert served.url.endswith(f"/?token={token}")
    wrong = ("", "?token=", "?token=wrong", f"?token={token[:-1]}", f"?token={token}x", "?token=%C3%A4%FF")
    for query in wrong:
        for path in ("/", "/api/map", "/main.js", "/api/stream", "/nowhere"):
            for method in ("GET", "POST"):
                assert ask(port, path + query, method)[0] == 401, path + query
        with pytest.raises(InvalidStatus, match="403"), raw_viewer(port, query):
            pass
    assert token not in str(ask(port)[2])
    assert ask(port, "/api/map", Authorization="Bearer wrong")[0] == 401
    assert ask(port, "/api/map", Cookie=f"edgemap-{port}=wrong")[0] == 401
    assert serve(host="0.0.0.0").token != token
    assert serve().token == ""


def test_the_token_lets_in_and_leaves_the_address_bar(serve):
    served = serve(host="0.0.0.0")
    port, token = served.port, served.token
    status, headers, _ = ask(port, f"/?token={token}")
    assert (status, headers["location"]) == (303, "/")
    cookie = headers["set-cookie"]
    assert "HttpOnly" in cookie
    kept = cookie.split(";")[0]
    assert ask(port, Cookie=kept)[0] == 200
    assert ask(port, f"/api/map?token={token}")[0] == 200
    assert ask(port, "/api/map", Authorization=f"Bearer {token}")[0] == 200
    with raw_viewer(port, additional_headers={"Cookie": kept}) as viewer:
        assert viewer.hello["type"] == "hello"
    stranger = raw_viewer(port, origin="http://evil.example", additional_headers={"Cookie": kept})
    with pytest.raises(InvalidStatus), stranger:
        pass


def test_a_long_cookie_costs_nothing_and_headers_are_bounded(serve):
    # http.cookies takes four seconds of processor for it, and the run waits meanwhile.
    assert cookie_value({"cookie": 'x=1; edgemap="' + "\\" * 60_000}, "edgemap") == '"' + "\\" * 60_000
    served = serve(host="0.0.0.0")
    assert ask(served.port, Cookie=f'edgemap-{served.port}="' + "\\" * 60_000 + '"')[0] == 401
    assert issubclass(WaitingLimited, H11Protocol)
    with socket.create_connection(("127.0.0.1", serve().port), timeout=60) as rude:
        rude.sendall(b"GET / HTTP/1.1\r\n")
        with suppress(ConnectionError):
            for _ in range(2000):
                rude.sendall(b"X-Long: " + b"a" * 1000 + b"\r\n")
        with suppress(ConnectionError):
            assert rude.recv(100).startswith(b"HTTP/1.1 400") or not rude.recv(1)


def test_a_taken_port_and_a_foreign_address_are_one_line_each(serve, tmp_path):
    served = serve()
    with pytest.raises(ViewError, match=rf"127.0.0.1:{served.port} \(Address already in use\); choose another --view"):
        PageServer(served.page, "127.0.0.1", served.port)
    with pytest.raises(ViewError, match="Cannot assign requested address"):
        PageServer(served.page, "192.0.2.7", 0)
    with pytest.raises(ViewError, match="not a name or address"):
        PageServer(served.page, "no.such.host.invalid", 0)
    with pytest.raises(ViewError, match="70000: the port must be 0 to 65535"):
        PageServer(served.page, "127.0.0.1", 70000)


def test_an_update_is_what_changed_since_the_last(serve):
    served = serve(steps=4)
    with raw_viewer(served.port, stream=True) as viewer:
        first = viewer.update()
        assert (first["frame"], first["state"]) == (3, "running")
        assert {item["id"] for item in first["changed"]} == {"chair-1", "couch-1"}
        assert len(first["trail"]) == 4
        assert first["jpeg"].startswith(b"\xff\xd8")
        by_label = {box["label"]: box for box in first["boxes"]}
        assert by_label["person"]["distance_m"] is None
        assert by_label["chair"]["object"] == "chair-1"
        assert by_label["chair"]["distance_m"] == pytest.approx((2.85**2 + 1.0) ** 0.5, abs=1e-3)
        viewer.say("shown")
        served.step()
        second = viewer.update()
        assert (second["frame"], len(second["trail"])) == (4, 1)
        viewer.say("shown")
        served.page.fault(Fault(FaultKind.OTHER, "the camera fell off"))
        third = viewer.update()
        assert third["faults"] == [{"frame": 4, "kind": "other", "text": "the camera fell off", "remedy": ""}]
        assert third["jpeg"] == b""  # the same picture is not sent twice
        assert third["changed"] == []


def test_after_a_relocation_all_is_sent_anew(serve):
    served = serve(steps=3)
    with raw_viewer(served.port, stream=True) as viewer:
        first = viewer.update()
        assert (first["moved"], len(first["trail"])) == (False, 3)
        assert "sightings" not in first
        viewer.say("shown")
        result, objects = served.steps.next()
        moved = SE2(10.0, 0.0, 0.0)
        result.trajectory.transform(moved)
        served.page.write(replace(result, relocated=moved), objects)
        second = viewer.update()
        assert second["moved"]
        assert [place[0] for place in second["trail"][:3]] == pytest.approx([10.0, 10.05, 10.1])
        assert {item["id"] for item in second["changed"]} == {"chair-1", "couch-1"}
        viewer.say("sightings")
        while not (found := viewer.update().get("sightings")):
            viewer.say("shown")
        assert found[0][:2] == ["chair", "chair-1"]
        assert found[0][2:] == pytest.approx([13.0, 1.0])


def test_a_viewer_that_shows_nothing_is_sent_a_few_and_stops_nobody(serve):
    """Frames are counted: the fast viewer sees all twenty, the slow one gets a few, and then the newest."""
    served = serve()
    with raw_viewer(served.port) as slow, raw_viewer(served.port) as fast:
        slow.say("stream")
        fast.say("stream")
        seen = []
        for frame in range(20):
            served.step()
            while not seen or seen[-1] < frame:
                seen.append(fast.update().get("frame", -1))
                fast.say("shown")
        assert set(range(20)) <= set(seen)
        numbers = [slow.update()["number"] for _ in range(IN_FLIGHT)]
        assert numbers == list(range(IN_FLIGHT))
        with pytest.raises(TimeoutError):
            slow.update(limit_s=0.2)
        slow.say("shown")
        caught_up = slow.update()
        assert (caught_up["frame"], caught_up["number"]) == (19, IN_FLIGHT)
        assert served.page.newest.result.frame.index == 19


def test_an_answer_that_is_three_pictures_late_costs_no_picture(serve):
    """As over a link of 300 ms, there and back, at 10 Hz."""
    served, late = serve(), 3
    with raw_viewer(served.port, stream=True) as viewer:
        viewer.update()  # before the first picture
        for frame in range(20):
            served.step()
            update = viewer.update()
            assert (update["frame"], update["jpeg"] != b"") == (frame, True)
            if frame >= late - 1:
                viewer.say("shown")


def test_nothing_is_sent_or_encoded_while_nobody_looks(serve, monkeypatch):
    served = serve()
    with raw_viewer(served.port, stream=True) as viewer:
        viewer.update()
        viewer.say("shown")
        viewer.say("stream", on=False)
        viewer.drain(1.3)  # what was under way; longer than a sign of life takes
        asked = []
        monkeypatch.setattr(served.page, "wake_once", asked.append)
        served.step(5)
        assert not asked  # no call into the server's thread from here on
        with pytest.raises(TimeoutError):
            viewer.update(limit_s=0.2)
        viewer.say("stream")
        assert viewer.update()["frame"] == 4


def test_a_rude_viewer_is_shown_out_and_the_rest_stay(serve):
    served = serve(steps=1)
    rude = ("no json", '{"do":"format the disk"}', '{"do":"stream","on":3}', '{"do":"pause"}', b"\0\1", "x" * 10_000)
    with raw_viewer(served.port) as good:
        for text in rude:
            with raw_viewer(served.port) as viewer:
                viewer.socket.send(text)
                with pytest.raises(ConnectionClosed):
                    viewer.socket.recv(timeout=60)
        good.socket.send('{"do":"shown","x":' + "[" * 2000 + "]" * 2000 + "}")  # a deep unknown field
        good.say("stream")
        assert good.update()["frame"] == 0


def test_silent_connections_do_not_keep_the_owner_out(serve):
    """Seventy that say nothing and seventy that send half a header; whoever asks is answered."""
    served = serve(host="0.0.0.0")
    address = ("127.0.0.1", served.port)
    with ExitStack() as opened:
        silent = [opened.enter_context(socket.create_connection(address, timeout=60)) for _ in range(140)]
        for slow in silent[70:]:
            with suppress(OSError):
                slow.sendall(b"GET / HTTP/1.1\r\nHost: ")
        assert ask(served.port, "/api/map", Authorization=f"Bearer {served.token}")[0] == 200
        with raw_viewer(served.port, f"?token={served.token}") as viewer:
            assert viewer.hello["type"] == "hello"
            assert ask(served.port)[0] == 401


def test_there_is_an_end_to_how_many_may_look(serve):
    served = serve()
    with ExitStack() as opened:
        for _ in range(MAXIMUM_VIEWERS):
            opened.enter_context(raw_viewer(served.port))
        with pytest.raises(ConnectionClosed, match="viewers are looking already"), raw_viewer(served.port):
            pass
    with raw_viewer(served.port) as viewer:  # they have gone
        assert viewer.hello["type"] == "hello"


def test_a_server_that_dies_says_so_in_one_line(serve, monkeypatch):
    def die(self, sockets=None):
        raise OSError("too many open files")

    printed = []
    monkeypatch.setattr(uvicorn.Server, "run", die)
    monkeypatch.setattr("edgemap.view.server.print_message", printed.append)
    served = serve()
    wait_for(lambda: printed, "the server's end")
    assert printed == ["the live page is gone (OSError: too many open files); the run goes on"]
    served.step(2)


def test_closing_frees_the_port_even_with_viewers(serve):
    served = serve()
    with raw_viewer(served.port, stream=True) as viewer:
        served.step()
        viewer.update()
        served.server.close()
        assert "live page" not in {thread.name for thread in threading.enumerate()}
        again = serve(port=served.port)
        assert again.port == served.port
        with pytest.raises(ConnectionClosed):
            viewer.drain(60.0)


def test_an_edit_that_waits_when_the_page_closes_is_answered(serve, capfd):
    served = serve(steps=30)
    answers = []
    with served.stepping:  # the run takes no edit any more
        path = f"/api/objects/{served.page.newest.objects[0].id}"
        asking = threading.Thread(target=lambda: answers.append(Api(served.port)("PATCH", path, {"name": "x"})))
        asking.start()
        wait_for(lambda: served.page.edits._waiting, "the request")
        served.server.close()
        asking.join(10.0)
    ((status, _, body),) = answers
    assert (status, body) == (409, {"error": "the run has ended"})
    assert served.page.edits.submit(Edit("name", "x", name="y")).exception() is not None
    assert capfd.readouterr().err == ""
