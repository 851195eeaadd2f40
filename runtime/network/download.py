"""Downloads one file: resumable, with a progress bar, verified by its SHA-256 before use."""

import http.client
import json
import re
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import msgspec
from tqdm import tqdm

from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.frames.reading import Strict, decode_json, one_line, read_bytes
from edgemap.runtime.frames.version import VERSION
from edgemap.runtime.network.manifest_file import sha256_file
from edgemap.runtime.network.web import TimedHandler, WebOnly, is_url

TIMEOUT_S = 10.0  # to connect, and between two pieces
PIECE = 1 << 16  # bytes
LONGEST_S, SLOWEST_BYTES_S = 60.0, 20_000.0  # one second more for each of the latter
LARGEST_BYTES = 1 << 30  # of a file of unknown size
NOTES_BYTES = 4096


class DownloadError(EdgemapError):
    """A file that could not be fetched, or whose SHA-256 is another than expected."""


def download(
    url: str,
    target: Path,
    *,
    sums: tuple[str, ...] = (),
    label: str | None = None,
    timeout_s: float = TIMEOUT_S,
    maximum_bytes: int = LARGEST_BYTES,
    longest_s: float = LONGEST_S,
    progress: bool = True,
) -> Path:
    """Fetch `url` into `target`; an interrupted transfer leaves `target.part`, and the next call resumes it.

    sums: SHA-256 values, one of which the file must have; empty accepts any file. label: name of the source in messages
    (the URL by default). maximum_bytes, longest_s: limits of size and time; each SLOWEST_BYTES_S bytes received extend
    the time by one second. Only http and https are allowed, also in redirects, and no redirect from https to http.
    Raises DownloadError, one line; `target` appears only when it is complete and verified.
    """
    label = label or url
    part, notes = target.with_name(f"{target.name}.part"), target.with_name(f"{target.name}.part.json")
    try:
        with TimedHandler(longest_s) as clock:
            if target.is_file() and (not sums or sha256_file(target) in sums):
                return target
            target.parent.mkdir(parents=True, exist_ok=True)
            have, validator = _resume_point(part, notes, url, bool(sums))
            with _open(url, have, validator, timeout_s, clock) as reply:
                goes_on = (reply.headers.get("Content-Range") or "").startswith(f"bytes {have}-")
                have = have if reply.status == 206 and goes_on else 0
                total = _total(reply, have)
                if (total or 0) > maximum_bytes:
                    raise DownloadError(f"{label}: {total:,} bytes, expected {maximum_bytes:,} at most")
                notes.write_text(json.dumps({"url": url, "validator": _validator(reply)}), encoding="utf-8")
                done = _receive(
                    reply, part, have, total, maximum_bytes, clock, target.name if progress else None, label
                )
        if clock.over:
            raise DownloadError(f"{label}: too slow, {done:,} bytes so far; run again to go on from there")
        if total is not None and done != total:
            raise DownloadError(f"{label}: broke off after {done:,} of {total:,} bytes; run again to go on from there")
        if sums and (seen := sha256_file(part)) not in sums:
            _delete(part, notes)
            wanted = " or ".join(value[:12] + "…" for value in sums)
            raise DownloadError(f"{label}: sha256 {seen[:12]}…, expected {wanted}; deleted")
        part.replace(target)
        _delete(notes)
    except urllib.error.HTTPError as error:
        if error.code == 416:  # the partial file is not the beginning of the server's
            _delete(part, notes)
        raise DownloadError(f"{label}: HTTP {error.code} {one_line(error.reason)}") from None
    except (OSError, http.client.HTTPException, ValueError) as error:
        reason = getattr(error, "reason", None) or error
        words = f"no answer within {longest_s:g} s" if clock.over else _in_words(reason, timeout_s)
        raise DownloadError(f"{label}: {words}") from None
    return target


class _Notes(Strict):
    """The record beside a partial file: its URL, and the server's version tag."""

    url: str
    validator: Annotated[str, msgspec.Meta(max_length=1000, pattern=r"\A[\x20-\x7e]*\Z")]


def _delete(*paths: Path) -> None:
    for path in paths:
        path.unlink(missing_ok=True)


def _resume_point(part: Path, notes: Path, url: str, checked: bool) -> tuple[int, str]:
    """Number of bytes that can be kept, and the server's tag of the version that they belong to."""
    try:
        noted = decode_json(read_bytes(notes, NOTES_BYTES, DownloadError), _Notes, notes, DownloadError)
        same, validator = noted.url == url, noted.validator
    except DownloadError:
        same, validator = False, ""
    # Without the server's tag only the SHA-256 at the end shows whether both parts belong together.
    if not part.is_file() or not same or not (validator or checked):
        return 0, ""
    return part.stat().st_size, validator


@contextmanager
def _open(
    url: str, have: int, validator: str, timeout_s: float, clock: TimedHandler
) -> Iterator[http.client.HTTPResponse]:
    if not is_url(url):
        raise ValueError("not an http or https URL")
    headers = {"User-Agent": f"edgemap/{VERSION}", "Accept-Encoding": "identity"}
    if have:
        headers["Range"] = f"bytes={have}-"
        if validator:
            headers["If-Range"] = validator
    opener = urllib.request.build_opener(WebOnly, clock)
    with opener.open(urllib.request.Request(url, headers=headers), timeout=timeout_s) as reply:
        yield reply


def _total(reply: http.client.HTTPResponse, have: int) -> int | None:
    whole = re.search(r"/(\d{1,18})$", reply.headers.get("Content-Range") or "")
    if have and whole:
        return int(whole[1])
    length = reply.headers.get("Content-Length")
    return have + int(length) if length is not None and re.fullmatch(r"\d{1,18}", length) else None


def _validator(reply: http.client.HTTPResponse) -> str:
    tag = reply.headers.get("ETag") or ""
    mark = tag if tag and not tag.startswith("W/") else reply.headers.get("Last-Modified") or ""
    return one_line(mark, 1000)


def _receive(
    reply: http.client.HTTPResponse,
    part: Path,
    have: int,
    total: int | None,
    maximum_bytes: int,
    clock: TimedHandler,
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
                piece = reply.read1(PIECE)
            except http.client.IncompleteRead as broken:
                piece = broken.partial
            if not piece:
                return done
            stream.write(piece)
            bar.update(len(piece))
            done += len(piece)
            clock.until_s += len(piece) / SLOWEST_BYTES_S
            if done > maximum_bytes:
                raise DownloadError(f"{label}: more than {maximum_bytes:,} bytes, stopped")


def _in_words(reason: object, timeout_s: float) -> str:
    if isinstance(reason, TimeoutError):
        return f"no answer within {timeout_s:g} s"
    return one_line(getattr(reason, "strerror", None) or str(reason).strip() or type(reason).__name__)
