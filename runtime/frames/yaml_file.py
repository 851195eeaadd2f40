"""Reads YAML files as plain values."""

from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import yaml

from edgemap.geometry.errors import EdgemapError
from edgemap.runtime.frames.reading import one_line, read_text


class _Loader(yaml.SafeLoader):
    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """As the base class, without aliases: a small file of them can stand for any amount of memory."""
        if self.check_event(yaml.AliasEvent):
            raise yaml.YAMLError("an alias")
        return super().compose_node(parent, index)


# `!!opencv-matrix` of OpenCV's FileStorage: its rows, cols and data.
_Loader.add_constructor("tag:yaml.org,2002:opencv-matrix", partial(_Loader.construct_mapping, deep=True))


def read_yaml(path: Path, error: type[EdgemapError]) -> Any:
    """A file's one document: None, bool, int, float, str, list and dict with text keys. Raises `error`, one line."""
    text = read_text(path, error, 128 << 10)  # PyYAML reads some 100 kB a second
    text = text.removeprefix("%YAML:1.0")  # OpenCV's first line, which is no YAML
    text = text.rstrip().removesuffix("\n---")  # as `ros2 topic echo` ends a message
    try:
        tree = msgspec.to_builtins(yaml.load(text, _Loader), str_keys=True)
        msgspec.json.encode(tree)  # raises for halves of characters (`\ud800`), which no file can hold
    except (yaml.YAMLError, ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RecursionError) as why:
        raise error(f"{path}: not YAML ({one_line(why)})") from None
    return tree
