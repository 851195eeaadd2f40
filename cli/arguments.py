"""How options describe themselves in the help."""

from __future__ import annotations

from typing import Any

import tyro


def arg(**options: Any) -> Any:
    """`tyro.conf.arg` without a default that says nothing: None, True and False stand in the help text's own words."""
    return tyro.conf.arg(help_behavior_hint=_default, **options)


def _default(value: str) -> str:
    return "" if value in ("None", "True", "False") else f"(default: {value})"
