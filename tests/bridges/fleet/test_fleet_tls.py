"""The settings that docs/fleet.md shows: TLS with certificates on both sides; a robot writes below its own name."""

import json
import re
import shutil
import subprocess
import time
from pathlib import Path

import pytest
from support.rooms import mapped
from support.waiting import free_port

from edgemap.runtime.frames.errors import BridgeError
from edgemap.runtime.step.map_file import map_document

pytest.importorskip("zenoh", reason="zenoh is not installed (extra 'fleet')")

from edgemap.bridges.fleet.keeper import PlaceKeeper
from edgemap.bridges.fleet.network import open_session

DOCUMENTED = Path(__file__).parents[3] / "docs" / "fleet.md"


def certificates(folder):
    """An authority, the keeper's certificate and a robot's, made by openssl."""
    if shutil.which("openssl") is None:
        pytest.skip("no openssl here")

    def call(*words):
        subprocess.run(["openssl", *words], cwd=folder, check=True, capture_output=True)

    key = ["-newkey", "rsa:2048", "-nodes"]
    call("req", "-x509", *key, "-keyout", "ca.key", "-out", "ca.pem", "-days", "2", "-subj", "/CN=authority",
         "-addext", "basicConstraints=critical,CA:TRUE")  # fmt: skip
    for name in ("keeper", "vacuum"):
        text = "subjectAltName=IP:127.0.0.1,DNS:localhost\nextendedKeyUsage=serverAuth,clientAuth\n"
        (folder / f"{name}.ext").write_text(text)
        call("req", *key, "-keyout", f"{name}.key", "-out", f"{name}.csr", "-subj", f"/CN={name}")
        call("x509", "-req", "-in", f"{name}.csr", "-CA", "ca.pem", "-CAkey", "ca.key", "-CAcreateserial",
             "-out", f"{name}.pem", "-days", "2", "-extfile", f"{name}.ext")  # fmt: skip


def client(port, folder, name):
    tls: dict[str, str | bool] = {"root_ca_certificate": str(folder / "ca.pem")}
    if name:
        tls |= {"connect_certificate": str(folder / f"{name}.pem"), "connect_private_key": str(folder / f"{name}.key")}
        tls["enable_mtls"] = True
    settings = {
        "mode": "client",
        "connect": {"endpoints": [f"tls/127.0.0.1:{port}"], "timeout_ms": 3000, "exit_on_failure": True},
        "scouting": {"multicast": {"enabled": False}},
        "transport": {"link": {"tls": tls}},
    }
    path = folder / f"{name or 'stranger'}.json5"
    path.write_text(json.dumps(settings))
    return path


def test_only_certificates_of_the_authority_and_only_their_own_name(tmp_path, monkeypatch):
    certificates(tmp_path)
    port = free_port()
    shown = re.search(r"```json5\n(.*?)```", DOCUMENTED.read_text(), re.S)
    text = shown[1].replace("0.0.0.0:7447", f"127.0.0.1:{port}")
    text = re.sub(r'"(\w+\.(?:pem|key))"', lambda found: json.dumps(str(tmp_path / found[1])), text)
    settings = tmp_path / "keeper.json5"
    settings.write_text(text)
    monkeypatch.setenv("ZENOH_CONFIG", str(settings))
    keeper = PlaceKeeper("home", tmp_path / "home")
    try:
        monkeypatch.setenv("ZENOH_CONFIG", str(client(port, tmp_path, "")))
        with pytest.raises(BridgeError):
            open_session().close()
        monkeypatch.setenv("ZENOH_CONFIG", str(client(port, tmp_path, "vacuum")))
        robot = open_session()
        message = json.dumps(map_document(mapped([("chair", 0.0, 0.0)])))
        token = robot.liveliness().declare_token("edgemap/fleet/home/robots/vacuum")
        robot.put("edgemap/fleet/home/robots/other/map", message)
        end_s = time.monotonic() + 20.0
        while not any(one.latest for one in keeper.robots.values()) and time.monotonic() < end_s:
            robot.put("edgemap/fleet/home/robots/vacuum/map", message)
            keeper.update()
            time.sleep(0.1)
        time.sleep(0.5)
        keeper.update()
        assert list(keeper.robots) == ["vacuum"]
        assert keeper.robots["vacuum"].here
        replies = [reply.ok for reply in robot.get("edgemap/fleet/home/map", timeout=5.0)]
        assert any(replies)
        token.undeclare()
        robot.close()
    finally:
        keeper.close()
