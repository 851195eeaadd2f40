"""Downloads against a local server, the package index's pages, and the bundle store."""

import io
import json
import shutil
import sys
import tarfile
from functools import partial
from hashlib import sha256

import pytest
from support.refusal import refused

from edgemap.cli import pull
from edgemap.export import obtain as obtaining
from edgemap.export.obtain import obtain
from edgemap.export.sources import KNOWN, KnownModel, SourceArchive
from edgemap.runtime.frames.errors import BundleError
from edgemap.runtime.network import download as downloading
from edgemap.runtime.network import store
from edgemap.runtime.network.bundle import load_bundle
from edgemap.runtime.network.download import DownloadError, download
from edgemap.runtime.network.manifest_file import read_manifest, write_manifest

DATA = bytes(range(256)) * 1000
SUM = sha256(DATA).hexdigest()


refusal = partial(refused, (DownloadError, BundleError))


def get(server, target, path="/f", **options):
    return download(server.url(path), target, progress=False, **options)


def test_a_broken_transfer_and_a_wrong_sum_leave_nothing_and_the_next_one_is_complete(server, tmp_path):
    server.files["/f"] = DATA
    text = refusal(get, server, tmp_path / "f", sums=("0" * 64, "1" * 64))
    assert f"sha256 {SUM[:12]}…, expected 000000000000… or 111111111111…" in text
    assert list(tmp_path.iterdir()) == []
    server.files["/f"], server.cut = DATA, 100_000
    assert "100000 bytes read, 156000 more expected" in refusal(get, server, tmp_path / "f", sums=(SUM,))
    assert list(tmp_path.iterdir()) == []
    server.cut = None
    assert get(server, tmp_path / "f", sums=(SUM,)).read_bytes() == DATA
    assert [path.name for path in tmp_path.iterdir()] == ["f"]


def test_unreachable_sources_are_one_line_each(server, tmp_path, monkeypatch):
    server.slow.add("/slow")
    monkeypatch.setattr(downloading, "SILENCE_S", 0.2)
    assert refusal(get, server, tmp_path / "f", "/none").endswith("/none: HTTP 404 Not Found")
    assert "no answer within 0.2 s" in refusal(get, server, tmp_path / "f", "/slow")
    assert "Connection refused" in refusal(download, "http://127.0.0.1:9/f", tmp_path / "f", progress=False)
    secret = refusal(download, "http://user:secret@host:x/f", tmp_path / "f", label="index", progress=False)
    assert secret.startswith("index: ")
    assert "secret" not in secret
    (tmp_path / "file").write_text("")
    server.files["/f"] = DATA
    assert "File exists" in refusal(get, server, tmp_path / "file" / "f")


@pytest.mark.parametrize("text", ["file:///etc/passwd", "ftp://x/y", "http://[", "x", "", "data:,x"])
def test_what_is_no_url(text, tmp_path):
    assert "not an http or https URL" in refusal(download, text, tmp_path / "f", progress=False)


def test_what_is_there_and_right_is_not_fetched_again_and_progress_goes_to_stderr(server, tmp_path, capsys):
    (tmp_path / "f").write_bytes(DATA)
    get(server, tmp_path / "f", sums=(SUM,))
    assert server.asked == []
    server.files["/f"] = DATA
    download(server.url("/f"), tmp_path / "g")
    out, err = capsys.readouterr()
    assert out == ""
    assert "256k" in err


ARCHIVE = SourceArchive("toy", "0.1", "toy/data/w.bin")


def toy_archive(content=DATA, member="toy-0.1/toy/data/w.bin"):
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w:gz") as tar:
        for name, data in (("toy-0.1/setup.py", b"raise SystemExit('never run')"), (member, content)):
            info = tarfile.TarInfo(name)
            info.size = len(data)
            tar.addfile(info, io.BytesIO(data))
    return buffer.getvalue()


def model(*sources):
    return KnownModel("toy", "w.bin", (SUM,), "none", sources)


def test_sources_are_tried_in_turn_and_the_mirror_is_read_from_an_archive(server, cache, monkeypatch):
    data = toy_archive()
    page = f'<html><a href="../../files/toy-0.1.tar.gz#sha256={sha256(data).hexdigest()}">toy-0.1.tar.gz</a></html>'
    server.files |= {"/simple/toy/": page.encode(), "/files/toy-0.1.tar.gz": data}
    monkeypatch.setenv("PIP_INDEX_URL", server.url("/simple"))
    path, sources = obtain(model(server.url("/gone"), ARCHIVE))
    assert path.read_bytes() == DATA
    assert sources == (f"package index, toy 0.1, toy/data/w.bin sha256 {SUM}",)
    assert server.asked == ["/gone", "/simple/toy/", "/files/toy-0.1.tar.gz"]
    assert sorted(p.name for p in path.parent.iterdir()) == ["w.bin"]
    server.asked.clear()
    assert obtain(model(ARCHIVE))[0] == path  # from the cache
    assert server.asked == []


@pytest.mark.parametrize(
    ("archive", "words"),
    [
        (toy_archive(DATA[1:]), "expected " + SUM[:12]),
        (toy_archive(member="toy-0.1/other"), "no member toy-0.1/toy/data/w.bin"),
        (b"no archive at all", "archive cannot be read"),
    ],
)
def test_a_bad_archive_is_refused(server, cache, monkeypatch, archive, words):
    page = f'<a href="/a.tar.gz#sha256={sha256(archive).hexdigest()}">toy-0.1.tar.gz</a>'
    server.files |= {"/simple/toy/": page.encode(), "/a.tar.gz": archive}
    monkeypatch.setenv("PIP_INDEX_URL", server.url("/simple/"))
    text = refusal(obtain, model(ARCHIVE))
    assert words in text
    assert len(text.splitlines()) == 1
    assert text.endswith("; with the file at hand: edgemap pull toy --from FILE")
    assert not list((cache / "downloads").glob("w.bin*"))


def test_index_pages(monkeypatch):
    good = "a" * 64
    page = f'<a href="/x/toy-0.1-py3-none-any.whl#sha256={good}">toy-0.1-py3-none-any.whl</a>'
    base = "https://index.example/simple/toy/"
    assert "not on the project's page (1 files there)" in refusal(obtaining.archive_link, page, base, ARCHIVE)
    page += f'<a data-x="1" href="../../p/toy-0.1.tar.gz#sha256={good}">toy-0.1.tar.gz</a>'
    assert obtaining.archive_link(page, base, ARCHIVE) == ("https://index.example/p/toy-0.1.tar.gz", good)
    page = '<a href="/x/toy-0.1.tar.gz#md5=abc">toy-0.1.tar.gz</a>'
    assert "carries no sha256" in refusal(obtaining.archive_link, page, base, ARCHIVE)
    monkeypatch.setenv("PIP_INDEX_URL", "https://user:secret@index.example/simple")
    assert obtaining.index_url() == "https://user:secret@index.example/simple"
    monkeypatch.delenv("PIP_INDEX_URL")
    monkeypatch.setattr(sys, "executable", "/nonexistent/python")
    assert refusal(obtaining.index_url) == "package index: pip names none"


def test_a_file_of_the_users_own_is_checked_too(server, cache, tmp_path, monkeypatch):
    monkeypatch.setattr(obtaining, "fetch_member", None)
    (tmp_path / "mine").write_bytes(DATA)
    path, sources = obtain(model(), str(tmp_path / "mine"))
    assert path.read_bytes() == DATA
    assert sources == (f"mine sha256 {SUM}",)
    (tmp_path / "mine").write_bytes(DATA[1:])
    assert "toy has " + SUM[:12] in refusal(obtain, model(), str(tmp_path / "mine"))
    assert "no such file" in refusal(obtain, model(), str(tmp_path / "none"))
    server.files["/w"] = DATA
    path.unlink()
    assert obtain(model(), server.url("/w"))[0].read_bytes() == DATA


def test_sums_of_the_known_models(shared_data):
    for name in ("yolov3-tiny", "yolox-nano"):
        data = (shared_data / "weights" / KNOWN[name].file).read_bytes()
        assert sha256(data).hexdigest() in KNOWN[name].sums


def test_a_finished_bundle_comes_by_folder(cache, small):
    folder = store.install_folder(small)
    assert folder == store.bundle_folder("small") == cache / "bundles" / "small"
    load_bundle(folder)
    assert store.install_folder(folder) == folder
    assert [path.name for path in folder.parent.iterdir()] == ["small"]


def test_a_finished_bundle_comes_by_url_and_a_damaged_one_does_not(cache, small, server):
    for path in small.iterdir():
        server.files[f"/b/{path.name}"] = path.read_bytes()
    pull.command(server.url("/b/"))
    folder = cache / "bundles" / "small"
    load_bundle(folder)
    shutil.rmtree(folder)
    assert store.install_url(server.url("/b/bundle.json")) == folder
    server.files["/b/odometry.paper.onnx"] = server.files["/b/odometry.paper.onnx"][:-1] + b"x"
    assert "odometry.paper.onnx: sha256" in refusal(store.install_url, server.url("/b"))
    load_bundle(folder)  # the older one stays
    shutil.rmtree(folder)
    refusal(store.install_url, server.url("/b"))
    assert not folder.exists()
    server.files["/b/bundle.json"] = b"{}"
    assert "bundle.json" in refusal(store.install_url, server.url("/b"))


def test_a_damaged_folder_or_an_evil_name_is_not_installed(cache, small):
    manifest = read_manifest(small)
    manifest.name = "../../evil"
    write_manifest(small, manifest)
    assert "is no file name" in refusal(store.install_folder, small)
    manifest.name = "good"
    write_manifest(small, manifest)
    (small / "backbone.onnx").write_bytes(b"x")
    assert "damaged" in refusal(store.install_folder, small)
    assert not (cache / "bundles" / "good").exists()


def test_where_a_bundle_is_looked_for(cache, small, tmp_path, monkeypatch):
    assert store.bundle_folder(str(small)) == small
    assert store.bundle_folder("small") == cache / "bundles" / "small"
    assert str(store.bundle_folder("a/b")) == "a/b"
    monkeypatch.chdir(small.parent)
    assert store.bundle_folder("small").resolve() == small.resolve()  # a bundle here comes before the cache
    (tmp_path / "small").mkdir()
    monkeypatch.chdir(tmp_path)
    assert store.bundle_folder("small") == cache / "bundles" / "small"  # a folder without a bundle does not
    monkeypatch.setattr(store, "shipped_folder", lambda: small.parent)
    assert store.bundle_folder("small") == small  # one that comes with the package, before the cache


def test_pull_makes_a_ready_bundle_and_a_second_pull_is_at_once(cache, shared_data, monkeypatch, capsys, brief):
    pull.command("yolox-nano", given=str(shared_data / "weights" / "yolox_nano.onnx"))
    folder = cache / "bundles" / "yolox-nano"
    assert capsys.readouterr().out == f"ready: {folder}\n"
    load_bundle(folder)
    assert "yolox_nano.onnx sha256 e8af074932d4" in json.loads((folder / "bundle.json").read_text())["sources"][0]
    monkeypatch.setattr("edgemap.runtime.frames.extras.find_spec", lambda name: None)  # as on a robot
    assert pull.pull_known("yolox-nano") == folder
    (folder / "backbone.onnx").write_bytes(b"damaged")
    with pytest.raises(Exception, match=r"needs torch, onnx, onnxscript: .*pip install .*\[export\]'"):
        pull.pull_known("yolox-nano")
    assert "neither a bundle's folder nor URL, nor a known model" in refusal(pull.pull_known, "nix")
