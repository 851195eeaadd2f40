"""Puts the live page's HTML, CSS and JavaScript and a run's data into one file that asks for nothing."""

import json
import re
from base64 import b64encode
from functools import cache
from hashlib import sha256
from html import escape
from pathlib import Path
from typing import Any

STATIC = Path(__file__).parents[1] / "static"
_IMPORT = re.compile(r'^import \{ (.+) \} from "/(\w+)\.js";\n', re.MULTILINE)
_EXPORT = re.compile(r"^export ((?:async )?(?:function|class|const) (\w+))", re.MULTILINE)


def report_page(document: dict[str, Any]) -> str:
    """The complete page as text. document: of `report_document`. NaN and infinity become null."""
    text = json.dumps(document, default=float)
    finite = json.dumps(json.loads(text, parse_constant=lambda _: None), separators=(",", ":"))
    embedded = finite.replace("<", "\\u003c")  # no text ends the element or opens a comment in it
    before, after = _frame(escape(str(document["about"]["camera"])))
    return f'{before}<script id="run-data" type="application/json">{embedded}</script>\n{after}'


@cache
def _frame(title: str) -> tuple[str, str]:
    """The page before and after its data."""
    page, script = (STATIC / "index.html").read_text("utf-8"), bundled("main")
    hashed = b64encode(sha256(script.encode()).digest()).decode()
    policy = f"default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'sha256-{hashed}'"
    style = (STATIC / "style.css").read_text("utf-8")
    icon = b64encode((STATIC / "icon.svg").read_bytes()).decode()
    meta = '<meta charset="utf-8">'
    for old, new in (
        (meta, f'{meta}\n<meta http-equiv="Content-Security-Policy" content="{policy}">'),
        ('href="/icon.svg"', f'href="data:image/svg+xml;base64,{icon}"'),
        ('<link rel="stylesheet" href="/style.css">', f"<style>{style}</style>"),
        ('<script type="module" src="/main.js"></script>', f'<script type="module">{script}</script>'),
        ("<title>edgemap</title>", f"<title>{title} – edgemap</title>"),
        ('<body data-source="live">', '<body data-source="saved">'),
    ):  # fmt: skip
        if old not in page:
            raise ValueError(f"{STATIC / 'index.html'} lacks {old}")
        page = page.replace(old, new)
    before, end, after = page.rpartition("</body>")
    return before, end + after


def bundled(name: str) -> str:
    """A module of the page with all that it imports as one script, each module a function of its own. Raises ValueError
    for an import or export of another form."""
    parts: dict[str, str] = {}

    def add(name: str) -> None:
        if name in parts:
            return
        parts[name] = ""  # before what it imports: a cycle ends
        source = (STATIC / f"{name}.js").read_text("utf-8")
        for match in _IMPORT.finditer(source):
            add(match[2])
        body = _IMPORT.sub(lambda match: f"const {{ {match[1]} }} = module_{match[2]};\n", source)
        names = ", ".join(match[2] for match in _EXPORT.finditer(source))
        body = _EXPORT.sub(r"\1", body)
        if re.search(r"^(import|export)\b", body, re.MULTILINE):
            raise ValueError(f"{name}.js: an import or export that cannot be bundled")
        del parts[name]  # after what it imports
        parts[name] = f"const module_{name} = (() => {{\n{body}\nreturn {{ {names} }};\n}})();\n"

    add(name)
    return "".join(parts.values())
