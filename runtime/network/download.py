"""Downloads a file with pooch, verified by its SHA-256 before use."""

from contextlib import suppress
from pathlib import Path
from urllib.parse import urlsplit

from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.frames.limits import SILENCE_S
from edgemap.runtime.frames.reading import one_line
from edgemap.runtime.network.manifest_file import sha256_file


class DownloadError(EdgemapError):
    """A file that could not be fetched, or whose SHA-256 is another than expected."""


def is_url(text: str) -> bool:
    """Whether a text is an http or https URL."""
    try:
        return urlsplit(text).scheme in ("http", "https")
    except ValueError:  # `http://[`
        return False


def download(url: str, target: Path, *, sums: tuple[str, ...] = (), label: str = "", progress: bool = True) -> Path:
    """Fetches `url` into `target`, which appears only when it is complete and verified.

    A file that is there and has the right sum is not fetched again.

    sums: SHA-256 values, one of which the file must have; empty accepts any file. label: the source in messages in
    place of the URL, which may hold a password. Raises DownloadError, one line.
    """
    import requests
    from pooch import HTTPDownloader

    label = label or url
    if not is_url(url):
        raise DownloadError(f"{label}: not an http or https URL")
    part = target.with_name(f"{target.name}.part")
    try:
        if target.is_file() and sha256_file(target) in sums:
            return target
        target.parent.mkdir(parents=True, exist_ok=True)
        HTTPDownloader(progressbar=progress, timeout=SILENCE_S)(url, str(part), None)
        if sums and (seen := sha256_file(part)) not in sums:
            wanted = " or ".join(value[:12] + "…" for value in sums)
            raise DownloadError(f"{label}: sha256 {seen[:12]}…, expected {wanted}; deleted")
        part.replace(target)
    except requests.HTTPError as error:
        answer = error.response
        why = "" if answer is None else f"{answer.status_code} {one_line(answer.reason)}"
        raise DownloadError(f"{label}: HTTP {why}") from None
    except requests.Timeout:
        raise DownloadError(f"{label}: no answer within {SILENCE_S:g} s") from None
    except (requests.RequestException, OSError, ValueError) as error:
        raise DownloadError(f"{label}: {_cause(error).replace(url, label)}") from None
    finally:
        with suppress(OSError):
            part.unlink()
    return target


def _cause(error: BaseException) -> str:
    """The first error of a chain in words: texts of requests hold addresses of objects."""
    while (before := error.__cause__ or error.__context__) is not None:
        error = before
    return one_line(getattr(error, "strerror", None) or str(error).strip() or type(error).__name__)
