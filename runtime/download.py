"""Downloads one file: resumable, with a progress bar, its sum checked before anyone opens it."""

from __future__ import annotations

import http.client
import json
import re
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from urllib.parse import urlsplit

from tqdm import tqdm

from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.manifest import sha256_file

TIMEOUT_S = 10.0  # to connect, and between two pieces
PIECE = 1 << 16  # bytes


class DownloadError(EdgemapError):
    """A file that could not be fetched, or is not the one that was promised."""


def is_url(text: str) -> bool:
    """Whether a text is an http or https URL."""
    return urlsplit(text).scheme in ("http", "https")


def download(
    url: str,
    target: Path,
    *,
    sums: tuple[str, ...] = (),
    label: str | None = None,
    timeout_s: float = TIMEOUT_S,
    most_bytes: int | None = None,
    progress: bool = True,
) -> Path:
    """Fetch `url` into `target`; a broken transfer leaves `target.part` and goes on from there the next time.

    sums: SHA-256 values, one of which the file must have; empty takes any. label: what messages call the source
    (the URL by default). Raises DownloadError, one line; `target` appears only when it is whole and right.
    """
    if target.is_file() and (not sums or sha256_file(target) in sums):
        return target
    label = label or url
    target.parent.mkdir(parents=True, exist_ok=True)
    part, notes = _part_of(target), _notes_of(target)
    have, validator = _resume_point(part, notes, url, bool(sums))
    try:
        with _open(url, have, validator, timeout_s) as reply:
            have = have if _continues(reply, have) else 0
            total = _total(reply, have)
            if most_bytes is not None and (total or 0) > most_bytes:
                raise DownloadError(f"{label}: {total:,} bytes, expected {most_bytes:,} at most")
            notes.write_text(json.dumps({"url": url, "validator": _validator(reply)}), encoding="utf-8")
            done = _receive(reply, part, have, total, most_bytes, target.name if progress else None, label)
    except urllib.error.HTTPError as error:
        if error.code == 416:  # what is there is no beginning of what the server has
            _forget(part, notes)
        raise DownloadError(f"{label}: HTTP {error.code} {error.reason}") from None
    except (OSError, http.client.HTTPException, ValueError) as error:
        reason = getattr(error, "reason", None) or error
        raise DownloadError(f"{label}: {_in_words(reason, timeout_s)}") from None
    if total is not None and done != total:
        raise DownloadError(f"{label}: broke off after {done:,} of {total:,} bytes; run again to go on from there")
    if sums and (seen := sha256_file(part)) not in sums:
        _forget(part, notes)
        raise DownloadError(
            f"{label}: sha256 {seen[:12]}…, expected {' or '.join(s[:12] + '…' for s in sums)}; deleted"
        )
    part.replace(target)
    notes.unlink(missing_ok=True)
    return target


def _part_of(target: Path) -> Path:
    return target.with_name(target.name + ".part")


def _notes_of(target: Path) -> Path:
    return target.with_name(target.name + ".part.json")


def _forget(part: Path, notes: Path) -> None:
    part.unlink(missing_ok=True)
    notes.unlink(missing_ok=True)


def _resume_point(part: Path, notes: Path, url: str, checked: bool) -> tuple[int, str]:
    """Bytes that are there and may be kept, and the server's mark of the version that they belong to."""
    try:
        noted = json.loads(notes.read_text(encoding="utf-8"))
        same, validator = noted["url"] == url, str(noted["validator"])
    except (OSError, ValueError, KeyError, TypeError):
        same, validator = False, ""
    # Without the server's mark only a sum at the end tells whether both halves belong together.
    if not part.is_file() or not same or not (validator or checked):
        return 0, ""
    return part.stat().st_size, validator


@contextmanager
def _open(url: str, have: int, validator: str, timeout_s: float) -> Iterator[http.client.HTTPResponse]:
    if not is_url(url):
        raise ValueError("not an http or https URL")
    headers = {"User-Agent": f"edgemap/{version('edgemap')}", "Accept-Encoding": "identity"}
    if have:
        headers["Range"] = f"bytes={have}-"
        if validator:
            headers["If-Range"] = validator
    with urllib.request.urlopen(urllib.request.Request(url, headers=headers), timeout=timeout_s) as reply:
        yield reply


def _continues(reply: http.client.HTTPResponse, have: int) -> bool:
    return reply.status == 206 and (reply.headers.get("Content-Range") or "").startswith(f"bytes {have}-")


def _total(reply: http.client.HTTPResponse, have: int) -> int | None:
    whole = re.search(r"/(\d+)$", reply.headers.get("Content-Range") or "")
    if have and whole:
        return int(whole[1])
    length = reply.headers.get("Content-Length")
    return have + int(length) if length is not None else None


def _validator(reply: http.client.HTTPResponse) -> str:
    tag = reply.headers.get("ETag") or ""
    return tag if tag and not tag.startswith("W/") else reply.headers.get("Last-Modified") or ""


def _receive(
    reply: http.client.HTTPResponse,
    part: Path,
    have: int,
    total: int | None,
    most_bytes: int | None,
    title: str | None,
    label: str,
) -> int:
    with (
        part.open("ab" if have else "wb") as stream,
        tqdm(total=total, initial=have, unit="B", unit_scale=True, desc=title, disable=title is None) as bar,
    ):
        done = have
        while True:
            try:
                piece = reply.read(PIECE)
            except http.client.IncompleteRead as broken:
                piece = broken.partial
            if not piece:
                return done
            stream.write(piece)
            bar.update(len(piece))
            done += len(piece)
            if most_bytes is not None and done > most_bytes:
                raise DownloadError(f"{label}: more than {most_bytes:,} bytes, stopped")


def _in_words(reason: object, timeout_s: float) -> str:
    if isinstance(reason, TimeoutError):
        return f"no answer within {timeout_s:g} s"
    return getattr(reason, "strerror", None) or str(reason).strip() or type(reason).__name__
