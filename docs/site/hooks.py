"""A hook of mkdocs: pages beside docs/ that the guides link to become pages of the site.

Links to other files lead to the repository, where its address is known."""

import os
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File

ROOT = Path(__file__).parents[2]
PAGES = ("models/README.md", "models/TRAINING.md", "models/EXPERIMENTS.md", "benchmarks/README.md")


def on_files(files: Any, config: Any) -> Any:
    """Adds the pages."""
    for page in PAGES:
        files.append(File.generated(config, page, abs_src_path=str(ROOT / page)))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Any) -> str:  # noqa: ARG001
    """Rewrites links to files outside of docs/."""
    source = page.file.src_uri
    folder = (ROOT / source if source in PAGES else ROOT / "docs" / source).parent

    def rewritten(match: re.Match[str]) -> str:
        words, target, anchor = match.groups(default="")
        path = (folder / target).resolve()
        if ":" in target or not target or not path.is_relative_to(ROOT):
            return match[0]
        uri = path.relative_to(ROOT).as_posix()
        if uri.startswith("docs/") or uri in PAGES:
            return f"[{words}]({os.path.relpath(uri.removeprefix('docs/'), Path(source).parent)}{anchor})"
        address = config["repo_url"]
        return f"[{words}]({address.rstrip('/')}/blob/main/{uri}{anchor})" if address else f"`{uri}`"

    return re.sub(r"(?<!!)\[([^\]]+)\]\(([^)#\s]*)(#[^)\s]*)?\)", rewritten, markdown)
