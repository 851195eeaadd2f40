"""The pages as a reader gets them: rendered with the site's own extensions, lists are lists and code is code."""

import html
import re
import statistics
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]
PAGES = sorted((ROOT / "docs").glob("*.md"))
markdown = pytest.importorskip("markdown")


def site():
    """mkdocs.yml, without what only mkdocs resolves (`!ENV`)."""

    class Loader(yaml.SafeLoader):
        pass

    Loader.add_constructor("!ENV", lambda loader, node: None)
    return yaml.load((ROOT / "mkdocs.yml").read_text(), Loader)


def rendered(text):
    named = site()["markdown_extensions"]
    names = [next(iter(one)) if isinstance(one, dict) else one for one in named]
    return markdown.markdown(text, extensions=names)


def without_code(page):
    return re.sub(r"<(pre|code)\b.*?</\1>", "", page, flags=re.S)


def faults_of(text):
    """What a reader would see broken in a page."""
    page = rendered(text)
    found = [f"fence left in the text: {line}" for line in without_code(page).splitlines() if "```" in line]
    fences = len(re.findall(r"^\s*```", text, re.M)) // 2
    if page.count('<div class="highlight">') != fences:
        found.append(f"{fences} fences, {page.count(chr(60) + 'div class=' + chr(34) + 'highlight')} blocks of code")
    paragraphs = re.findall(r"<p>(.*?)</p>", without_code(page), re.S)
    items = [line for part in paragraphs for line in part.splitlines() if re.match(r"\s*([-*]|\d+\.) ", line)]
    found += [f"list item in a paragraph: {html.unescape(line)}" for line in items]
    starts = [row for row in text.splitlines() if re.match(r"\d+\. ", row)]
    if starts and len(re.findall(r"<ol", page)) > sum(row.startswith("1. ") for row in starts):
        found.append("a numbered list falls apart")
    return found


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_lists_are_lists_and_code_is_code(page):
    assert not faults_of(page.read_text())


def test_every_page_is_in_the_menu_and_every_entry_is_a_page():
    def entries(part):
        if isinstance(part, str):
            return [part]
        return [page for one in (part if isinstance(part, list) else part.values()) for page in entries(one)]

    listed = entries(site()["nav"])
    pages = {str(path.relative_to(ROOT / "docs")) for path in (ROOT / "docs").rglob("*.md")}
    assert len(listed) == len(set(listed))
    beside = {page for page in listed if page.startswith(("models/", "benchmarks/"))}  # docs/site/hooks.py brings them
    assert all((ROOT / page).is_file() for page in beside)
    assert set(listed) - beside == {page for page in pages if not page.startswith("examples/")}


def test_the_readme_is_short_and_names_each_models_licence():
    text = (ROOT / "README.md").read_text()
    assert len(text.splitlines()) <= 130
    assert len((ROOT / "models" / "README.md").read_text().splitlines()) <= 120
    for bundle in (path.parent.name for path in (ROOT / "models").glob("*/bundle.json")):
        assert re.search(rf"`{bundle}`: Apache-2.0", text)
    first_screen = "\n".join(text.splitlines()[:20])
    assert "**Use it if**" in first_screen
    assert "**Do not use it if**" in first_screen


def sentences(text):
    """Lengths in words, of paragraphs and list items; code, tables, headings and addresses are none."""
    text = re.sub(r"```.*?```|<!--.*?-->", "", text, flags=re.S)
    text = re.sub(r"\]\([^)]*\)", "]", re.sub(r"`[^`]*`", "X", text))
    blocks = re.split(r"\n\s*\n|\n\s*(?=(?:[-*]|\d+\.) )", "\n" + text)
    prose = [block for block in blocks if not block.lstrip().startswith(("|", "#", "!", "    "))]
    return [len(part.split()) for block in prose for part in re.split(r"(?<=[.!?:;])\s", block) if part.strip()]


@pytest.mark.parametrize("page", [*PAGES, ROOT / "benchmarks" / "README.md"], ids=lambda page: page.name)
def test_pages_are_read_in_minutes(page):
    assert len(page.read_text().split()) <= 1200
    assert statistics.median(sentences(page.read_text())) <= 18


def test_a_change_is_one_line_of_fifteen_words():
    lines = (ROOT / "CHANGELOG.md").read_text().splitlines()
    assert not [line for line in lines if line and not line.startswith(("#", "- "))]
    assert not [line for line in lines if len(line.removeprefix("- ").split()) > 15]
