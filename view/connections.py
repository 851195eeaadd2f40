"""Limits the number of idle connections: a new one closes the oldest."""

import asyncio
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol

WAITING_LIMIT = 32

_Base: Any = H11Protocol  # uvicorn's other one, taken where httptools is installed, bounds no headers


class WaitingLimited(_Base):
    """uvicorn's HTTP protocol. A connection is idle while none of its requests is being answered, also while its
    headers arrive slowly. A client that sends its request at once is answered, no matter how many idle connections
    there are.
    """

    def connection_made(self, transport: asyncio.Transport) -> None:
        """As in the base class; closes the oldest idle connection beyond the limit."""
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
