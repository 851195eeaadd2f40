"""Connections that say nothing: so many wait for a request at most, and the oldest gives way to the newest."""

from __future__ import annotations

import asyncio
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol

WAITING_LIMIT = 32

_Base: Any = H11Protocol  # uvicorn's other one, taken where httptools is installed, bounds no headers


class WaitingLimited(_Base):
    """uvicorn's HTTP protocol. A connection waits while no request of it is being answered, also when its headers come
    drop by drop; whoever comes and asks at once is answered, however many others are silent."""

    def connection_made(self, transport: asyncio.Transport) -> None:
        """As the base class; closes the oldest of too many that wait."""
        super().connection_made(transport)
        self.made_s = asyncio.get_running_loop().time()
        waiting = [one for one in self.connections if isinstance(one, WaitingLimited) and one.waits]
        for one in sorted(waiting, key=lambda one: one.made_s)[:-WAITING_LIMIT]:
            one.transport.abort()
            self.connections.discard(one)

    @property
    def waits(self) -> bool:
        """Whether no request is being answered."""
        return self.cycle is None or self.cycle.response_complete
