import json

import pytest

import edgemap
from edgemap.runtime import extras
from edgemap.runtime.errors import CameraError, MissingExtraError


def test_three_lines_make_a_map(painted_bundle, pictures, tmp_path):
    with edgemap.open(camera=f"{pictures}", bundle=painted_bundle, odometry="planar") as session:
        results = list(session)
    assert [item.id for item in session.map] == ["chair-1"]
    assert results[-1].update.trajectory is session.slam.mapper.trajectory
    session.save(tmp_path / "map.json")
    assert json.loads((tmp_path / "map.json").read_text())["objects"][0]["id"] == "chair-1"


def test_a_source_without_a_mount_is_named(painted_bundle, pictures, tmp_path):
    bare = tmp_path / "bare"
    bare.mkdir()
    (bare / "0.png").write_bytes((pictures / "0.png").read_bytes())
    with pytest.raises(CameraError, match="brings no intrinsics: give its camera"):
        edgemap.open(camera=f"{bare}", bundle=painted_bundle)


def test_only_what_is_there_can_be_asked_for():
    with pytest.raises(AttributeError, match="no attribute 'run'"):
        _ = edgemap.run


@pytest.mark.parametrize(
    ("origin", "told"),
    [
        (
            '{"url": "file:///home/u/my%20clone", "dir_info": {"editable": true}}',
            "pip install -e '/home/u/my clone[view]'",
        ),
        ('{"url": "file:///home/u/clone", "dir_info": {}}', "pip install '/home/u/clone[view]'"),
        (None, "pip install 'edgemap-robot[view]'"),
    ],
)
def test_a_hint_works_from_where_the_installation_came(monkeypatch, origin, told):
    class Installed:
        def read_text(self, name):
            assert name == "direct_url.json"
            return origin

    monkeypatch.setattr(extras, "distribution", lambda name: Installed())
    assert extras.install_hint("view") == told
    with pytest.raises(MissingExtraError, match="the page needs no_such_module: pip install"):
        extras.need("view", "the page", ("json", "no_such_module"))
