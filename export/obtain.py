"""Downloads the file of a published model. URLs are tried in order; the checksum is verified before parsing."""

import shutil
from pathlib import Path

from edgemap.export.sources import KnownModel
from edgemap.runtime.frames.reading import user_path
from edgemap.runtime.network.download import DownloadError, download, is_url
from edgemap.runtime.network.manifest_file import sha256_file
from edgemap.runtime.network.store import cache_folder


def obtain(model: KnownModel, given: str | None = None, progress: bool = True) -> tuple[Path, tuple[str, ...]]:
    """Returns the model's file in the cache, and one line with its source and its SHA-256.

    given: a file or URL from the user, used instead of the listed URLs. Raises DownloadError, which names each URL.
    """
    target = cache_folder() / "downloads" / model.file
    if given is not None and not is_url(given):
        return _take(model, user_path(given), target), (f"{Path(given).name} sha256 {sha256_file(target)}",)
    if given is None and target.is_file() and sha256_file(target) in model.sums:
        return target, (f"{model.file} from the cache, sha256 {sha256_file(target)}",)
    failures = []
    for url in (given,) if given is not None else model.urls:
        try:
            download(url, target, sums=model.sums, progress=progress)
        except DownloadError as error:
            failures.append(str(error))
        else:
            return target, (f"{url} sha256 {sha256_file(target)}",)
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
