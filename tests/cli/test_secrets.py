"""A camera's password and token: nowhere in what a run prints, writes or serves."""

import pytest
from support.mjpeg import MjpegServer

from edgemap.runtime.frames.errors import UsageError
from edgemap.runtime.frames.option_texts import host_and_port
from edgemap.runtime.frames.reading import without_secrets

SECRETS = "h0rse", "battery", "staple"


@pytest.mark.parametrize(
    ("text", "hidden"),
    [
        ("rtsp://admin:pw@10.0.0.2:554/live", "rtsp://***@10.0.0.2:554/live"),
        ("rtsp://admin:p@ss@h/x", "rtsp://***@h/x"),
        ("rtsp://admin:p/w@h/x", "rtsp://***@h/x"),
        ("http://h:80/x?user=a&pwd=b&x=1", "http://h:80/x?***"),
        ("http://h/x#code=b, then", "http://h/x?*** then"),
        ("rtsp://h/user=a_password=b_channel=1.sdp", "rtsp://h?***"),
        ("rtsp://admin:p s@h/x", "rtsp://***@h/x"),
        ("rtsp://admin:" + "p" * 900 + "@h/x", "rtsp://***@h/x"),
        ("rtsp:/u:p@h/x.jpg", "rtsp:/***@h/x.jpg"),  # as a path has it
        ("""no 'rtsp://admin:p"w'x@h/x': gone""", "no 'rtsp://***@h/x': gone"),
        ('rtsp://admin:<p/"w>@h/x', "rtsp://***@h/x"),
        ("no camera 'admin:pw@10.0.0.2:554/live'", "no camera '***@10.0.0.2:554/live'"),
        ("admin:pw@cam.local, or a:b@localhost", "***@cam.local, or ***@localhost"),
        ("10.0.0.2/x?token=b&x=1 and h/y?x=1&api_key=c", "10.0.0.2/x?token=***&x=1 and h/y?x=1&api_key=***"),
        ('["http://h","http://h:80/x","c@d.e"]', None),
        ('{"a": "rtsp://u:p@h/x", "b": "c@d"}', '{"a": "rtsp://***@h/x", "b": "c@d"}'),
        ("http://h:8554/user@x wheel:/data/u@x.csv wheel:u@x.csv file:///home/x@y 10:30@x?y=1", None),
    ],
)
def test_addresses_lose_what_gives_access_and_nothing_else(text, hidden):
    assert without_secrets(text) == (hidden or text)
    assert without_secrets(without_secrets(text)) == (hidden or text)


@pytest.mark.parametrize("text", ["://", "://a:", "http:/", "?token", "://x?a:", 'a:"', "a:b@", "?token=", "&key"])
def test_a_hostile_text_takes_no_time(text):
    assert without_secrets(text * 5_000)  # seconds per kilobyte with lengths without a bound


def test_a_brokers_password_has_its_own_place():
    with pytest.raises(UsageError, match="come from the environment") as refused:
        host_and_port("robot:h0rse@broker:1883", "--mqtt", 1883)
    assert "h0rse" not in str(refused.value)


def test_nothing_that_a_command_prints_or_writes_holds_them(edgemap, painted_bundle, tmp_path):
    def said(*words):
        done = edgemap(*words, cwd=tmp_path)
        return (done.stdout + done.stderr).encode()

    lens = ("--mount", "0.6,11.5", "--intrinsics", "60,60,31.5,23.5", "--bundle", painted_bundle)
    with MjpegServer() as server:
        address = server.url.replace("//", f"""//admin:"{SECRETS[2]}'{SECRETS[0]}@""") + f"?access_token={SECRETS[1]}"
        prints = said("run", "--camera", address, *lens, "--frames", 6, "-o", "run", "--sink", "record:run.mcap")
        assert b"after 6 frames" in prints, prints
        prints += said("run", "--config", "run", "--config-options", "-o", "again")
        assert b"type --camera again" in prints
        prints += said("doctor", "--camera", address, *lens) + said("detect", address, "--bundle", painted_bundle)
    prints += said("run", "--camera", address, *lens, "-o", "gone") + said("run", "--camera", address + "[", "--nil")
    prints += said("doctor", "--camera", address.partition("//")[2], *lens) + said("detect", f"{address[7:]}/none")
    files = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    assert {"run.json", "report.html", "run.mcap"} <= {path.name for path in files}
    for where, text in {**files, "prints": prints}.items():
        for secret in SECRETS:
            assert secret.encode() not in text, (where, text[max(0, text.find(secret.encode()) - 200) :][:400])
