"""Reads files that may be damaged or hostile: bounded in size, decoded against a schema, every failure one line.

Every reader of edgemap begins here: `read_bytes` or `read_text` bounds what enters memory, `decode_json` and `convert`
check all of a document against a msgspec type with constraints before anything is made of it. Paths that OpenCV, PyAV,
librealsense or an engine opens go through `library_path`: Python keeps bytes of a name that are not UTF-8 as surrogates
(PEP 383), at which those libraries abort.
"""

import os
import re
import stat
import sys
from pathlib import Path
from typing import Annotated, Any, TypeVar

import msgspec
from msgspec import Meta

from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.frames.limits import FILE_BYTES, LINE, VALUES

T = TypeVar("T")

HIDDEN = r"\x00-\x1f\x7f-\x9f\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff"  # control characters, text directions

# Numbers and names as files may hold them. NaN and infinity satisfy no bound, so they are refused.
Coordinate = Annotated[float, Meta(ge=-1e6, le=1e6)]  # metres or pixels
Size = Annotated[float, Meta(ge=0.0, le=1e6)]  # metres or pixels
Stamp = Annotated[float, Meta(ge=-1e12, le=1e12)]  # seconds
Share = Annotated[float, Meta(ge=0.0, le=1.0)]
Side = Annotated[int, Meta(ge=1, le=65536)]  # of a picture, px
Name = Annotated[str, Meta(min_length=1, max_length=200, pattern=rf"\A[^{HIDDEN}]*\Z")]


# Of a URL: user and password, also where these hold `/`, `@` or quotes; a whole query or fragment, whatever its names;
# parts of a path that give access, as cheap cameras have them. Without a scheme: user and password before a host, and
# values of such names. Lengths are bounded, or a hostile text would take for ever.
URL = r"""(:/{2,3}|https?:/|rtsps?:/)"""
INNER_QUOTE = r"""["'](?![\s,:;}\])>]|$)"""
USER_INFO = re.compile(
    URL + rf"""(?:(?:[^\s/?#"']|{INNER_QUOTE}){{0,1000}}"""
    rf"""|[^\s/@:"'<>]{{0,200}}:(?!\d+(?:[/?#]|$))(?:[^\n"']|{INNER_QUOTE}){{0,1000}})@"""
)
LOGIN = re.compile(
    r"""(?<![\w/.:@*-])(?!(?:wheel|tf|drive|kitti|tum|c2w|euroc|locobot|yolo|realsense|record|bundle):)[\w.+-]{1,64}:"""
    r"""[^\s/@<>]{1,200}@(?=localhost|[\w-]{1,64}[.:/])"""
)
SECRET = r"""(?:pass|pwd|psw|user|token|auth|key)[^/&\s?#="'<>]{0,20}="""
QUERY = re.compile(URL + rf"""([^\s?#"'<>]{{0,300}}?)(?:[?#]|/[^/\s?#="'<>]{{0,40}}{SECRET})[^\s"'<>]+""")
VALUE = re.compile(rf"""([?&][^/&\s?#="'<>]{{0,40}}{SECRET})[^\s&"'<>]+""")


def without_secrets(text: str) -> str:
    """The text without user, password and access tokens of the addresses in it. Everything that is printed, written or
    sent and may hold one goes through it."""
    if ":/" in text:
        text = QUERY.sub(r"\1\2?***", USER_INFO.sub(r"\1***@", text))
    return VALUE.sub(r"\1***", LOGIN.sub("***@", text)) if "@" in text or "=" in text else text


class Strict(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    """A record of a file: unknown or missing fields are errors."""


THEIRS = (Exception, SystemExit)  # what code of another package may raise


def one_line(text: object, length: int = 200) -> str:
    """A text of any origin as part of a message: no line breaks, no control characters, not too long."""
    words = "".join(letter if letter.isprintable() else " " for letter in without_secrets(str(text)))
    words = " ".join(words.split())
    return words if len(words) <= length else words[: length - 1] + "…"


def error_line(error: BaseException) -> str:
    """An unknown error as part of a message: its kind and its text, where it has one that can be printed."""
    try:
        text = without_secrets(" ".join(str(error).split()))
    except Exception:  # of another package's class
        text = ""
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def printable(text: object) -> str:
    """A message for a terminal, one line: line breaks, control characters and halves of characters, as file names may
    hold, as escapes (`\\n`), and without the middle of what is too long."""
    text = without_secrets(str(text))
    if len(text) <= LINE and text.isprintable():
        return text
    line = "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)
    half = (LINE - 1) // 2
    return line if len(line) <= LINE else f"{line[:half]}…{line[-half:]}"


def print_message(text: object) -> None:
    """Prints a message to standard error, escaped by `printable`. All of edgemap's messages go through it."""
    print(printable(text), file=sys.stderr)


def user_path(text: str | Path) -> Path:
    """A path as a user types it: `~` is the home folder; that of an unknown user stays unexpanded."""
    try:
        return Path(text).expanduser()
    except (RuntimeError, ValueError):  # ValueError: a NUL in the name
        return Path(text)


def read_bytes(path: Path, error: type[EdgemapError], limit_bytes: int = FILE_BYTES) -> bytes:
    """All of a regular file. Raises `error` where it is missing, no file, unreadable or larger than the limit."""
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):  # a pipe would block, a device never end
            raise error(f"{path}: cannot be read (not a file)")
        if status.st_size > limit_bytes:
            raise error(f"{path}: {status.st_size:,} bytes, at most {limit_bytes:,} are read")
        with path.open("rb") as stream:
            data = stream.read(min(status.st_size, limit_bytes) + 1)  # takes memory for as much as it is asked for
    except (OSError, ValueError) as why:  # ValueError: a NUL in the path
        raise error(f"{one_line(path)}: cannot be read ({one_line(getattr(why, 'strerror', None) or why)})") from None
    return data


def read_text(path: Path, error: type[EdgemapError], limit_bytes: int = FILE_BYTES) -> str:
    """All of a UTF-8 file. Raises `error` as `read_bytes` does, and where it is not UTF-8."""
    try:
        return read_bytes(path, error, limit_bytes).decode("utf-8")
    except UnicodeDecodeError as why:
        raise error(f"{path}: cannot be read ({one_line(why)})") from None


def decode_json(data: bytes | str, kind: type[T], where: object, error: type[EdgemapError]) -> T:
    """A JSON document as a checked record. Raises `error`, which names the place in the document, and where it has too
    many values to be held in memory."""
    try:
        if isinstance(data, bytes):
            data = data.decode("utf-8")  # msgspec would take other bytes inside of strings
        if (values := sum(map(data.count, ",:[{"))) > VALUES:
            raise error(f"{where}: about {values:,} values, at most {VALUES:,} are read")
        tree = msgspec.json.decode(data)
    except (msgspec.DecodeError, UnicodeError) as why:
        raise error(f"{where}: not JSON ({one_line(why)})") from None
    except RecursionError:
        raise error(f"{where}: not JSON that is read (nested too deeply)") from None
    return convert(tree, kind, where, error)


def convert(tree: Any, kind: type[T], where: object, error: type[EdgemapError], strict: bool = True) -> T:
    """Plain values as a checked record. strict: else numbers may stand as text. Raises `error`."""
    try:
        return msgspec.convert(tree, kind, strict=strict)
    except (msgspec.ValidationError, OverflowError, UnicodeError) as why:
        raise error(f"{where}: {_reason(why, tree)}") from None
    except RecursionError:
        raise error(f"{where}: nested too deeply") from None


def _reason(why: Exception, tree: Any) -> str:
    """msgspec's message with the value that stands at the place it names."""
    place = re.search(r" - at `\$([^`]*)`\Z", str(why))
    for name, number in re.findall(r"\.(\w+)|\[(\d+)\]", place[1]) if place and "..." not in place[1] else ():
        try:
            tree = tree[name or int(number)]
        except (LookupError, TypeError):
            return one_line(why)
    if place is None or not isinstance(tree, str | int | float | None) or "missing" in str(why):
        return one_line(why)
    huge = isinstance(tree, int) and abs(tree) >= 1 << 64
    return f"{one_line(why)}, found {'a huge number' if huge else one_line(repr(tree), 100)}"


class FileNameError(EdgemapError):
    """A file name that a library written in C++ cannot be given."""


def library_path(path: str | Path) -> str:
    """The path as UTF-8 text for a library, independent of the locale. Raises FileNameError where it is not UTF-8."""
    try:
        return os.fsencode(path).decode("utf-8")
    except UnicodeError:
        raise FileNameError(f"{printable(path)}: the name is not UTF-8, rename the file or its folder") from None
