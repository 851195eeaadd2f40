"""YAML as plain values: no aliases, no tags of its own, no dates; bounded in size and depth."""

from pathlib import Path
from typing import Any

import yaml
from yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.frames.reading import one_line, read_text

YAML_BYTES = 128 << 10
DEPTH_LIMIT = 20
DIGIT_LIMIT = 400
TAGS = {f"tag:yaml.org,2002:{name}" for name in ("null", "bool", "int", "float", "str", "seq", "map")}


class _Refused(yaml.YAMLError):
    """What a plain YAML file does not hold."""


class _Loader(yaml.SafeLoader):
    depth = 0

    def compose_node(self, parent: Node | None, index: int) -> Node | None:
        """Composes a node as the base class does; refuses depth and aliases that could grow without bound."""
        if self.check_event(yaml.events.AliasEvent):
            raise _Refused(f"line {self.peek_event().start_mark.line + 1}: an alias")
        self.depth += 1
        if self.depth > DEPTH_LIMIT:
            raise _Refused(f"nested more than {DEPTH_LIMIT} deep")
        node = super().compose_node(parent, index)
        self.depth -= 1
        return node


def read_yaml(path: Path, error: type[EdgemapError]) -> Any:
    """A file's one document: None, bool, int, float, str, list and dict with text keys. Raises `error`, one line."""
    text = read_text(path, YAML_BYTES, error).removeprefix("%YAML:1.0")  # OpenCV's own first line, which is no YAML
    loader: _Loader | None = None
    try:
        loader = _Loader(text)
        node = loader.get_single_node()
        return None if node is None else _plain(loader, node)
    except (yaml.YAMLError, ValueError, LookupError) as why:  # yaml raises the latter two of `!!int x`, `!!bool x`
        raise error(f"{path}: not YAML ({one_line(why)})") from None
    finally:
        if loader is not None:
            loader.dispose()


def _plain(loader: _Loader, node: Node) -> Any:
    line = node.start_mark.line + 1
    if node.tag not in TAGS:
        raise _Refused(f"line {line}: {node.tag.removeprefix('tag:yaml.org,2002:')!r} is not a plain value")
    if isinstance(node, MappingNode):
        items: dict[str, Any] = {}
        for key, value in node.value:
            name = _plain(loader, key) if isinstance(key, ScalarNode) else None
            if not isinstance(name, str) or name in items:
                raise _Refused(f"line {key.start_mark.line + 1}: a key that is no text, or given twice")
            items[name] = _plain(loader, value)
        return items
    if isinstance(node, SequenceNode):
        return [_plain(loader, value) for value in node.value]
    if node.tag.endswith((":int", ":float")) and len(node.value) > DIGIT_LIMIT:
        raise _Refused(f"line {line}: a number of {len(node.value):,} digits")
    value = loader.construct_object(node)
    if isinstance(value, str) and any("\ud800" <= letter <= "\udfff" for letter in value):  # no text can hold these
        raise _Refused(f"line {line}: half a character")
    return value
