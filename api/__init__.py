"""edgemap: a map of the objects on the floor from one camera on two CPU cores.

`edgemap.open(camera=…, bundle=…)` is the whole product in one call; `edgemap.runtime` has its parts.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from edgemap.runtime.session import Session
    from edgemap.runtime.session import open_session as open

__version__ = "0.2.0"
__all__ = ["Session", "__version__", "open"]


def __getattr__(name: str) -> Any:
    """Import what is asked for, the first time (PEP 562)."""
    names = {"open": "open_session", "Session": "Session"}
    if name not in names:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from edgemap.runtime import session

    return getattr(session, names[name])
