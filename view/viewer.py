"""One browser's connection, with flow control: a slow browser skips updates."""

import asyncio
import time
from contextlib import suppress
from typing import Literal

import msgspec
from starlette.websockets import WebSocket, WebSocketDisconnect

from edgemap.view.page import LivePage
from edgemap.view.updates import Cursor, ProcessUsage

HIGHEST_RATE_HZ = 20.0
IN_FLIGHT = 4  # updates sent and not yet shown: a picture every 100 ms over a link that takes 300 ms, there and back
SIGN_OF_LIFE_S = 1.0  # an update at least this often, so that the page sees a silent camera


class Ask(msgspec.Struct):
    """A page's message. shown: an update was drawn. stream: whether it wants updates (off while hidden)."""

    do: Literal["shown", "stream", "sightings"]
    on: bool = True


class Bell:
    """Wakes the viewers' tasks when the page changes; costs the run nothing without waiting viewers."""

    def __init__(self, page: LivePage) -> None:
        self._page = page
        self._changed = asyncio.Event()

    async def newer(self, revision: int, limit_s: float) -> None:
        """Return once the page is newer than a revision, or after so many seconds."""
        loop = asyncio.get_running_loop()

        def ring() -> None:
            with suppress(RuntimeError):  # the loop may have ended
                loop.call_soon_threadsafe(self._changed.set)

        self._changed.clear()
        self._page.wake_once(ring)
        if self._page.revision == revision:
            with suppress(TimeoutError):
                await asyncio.wait_for(self._changed.wait(), limit_s)


class Viewer:
    """One WebSocket. It gets the newest state whenever it has room for one; nothing queues, a slow one skips frames."""

    def __init__(self, socket: WebSocket, page: LivePage, bell: Bell, usage: ProcessUsage) -> None:
        self._socket, self._page, self._bell, self._usage = socket, page, bell, usage
        self._cursor = Cursor()
        self._streams = False
        self._in_flight = 0
        self._room = asyncio.Event()

    async def serve(self) -> None:
        """Serves the browser until it disconnects."""
        await self._socket.accept()
        hello = {"type": "hello", "drives": bool(self._page.goals)} | self._page.about
        await self._socket.send_text(msgspec.json.encode(hello).decode())
        tasks = {asyncio.create_task(self._send()), asyncio.create_task(self._listen())}
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                with suppress(WebSocketDisconnect, RuntimeError):  # RuntimeError: starlette's, of a socket just closed
                    task.result()
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def _send(self) -> None:
        number = 0
        while True:
            await self._room.wait()
            await self._bell.newer(self._cursor.revision, SIGN_OF_LIFE_S)
            if not self._room.is_set():
                continue
            began_s = time.monotonic()
            message = self._cursor.update(self._page, self._usage, number)
            self._in_flight += 1
            self._make_room()
            await self._socket.send_bytes(message)
            number += 1
            await asyncio.sleep(max(0.0, began_s + 1.0 / HIGHEST_RATE_HZ - time.monotonic()))

    async def _listen(self) -> None:
        while True:
            try:
                ask = msgspec.json.decode(await self._socket.receive_text(), type=Ask)
            except (msgspec.MsgspecError, KeyError, TypeError):  # the latter two: a binary message
                await self._socket.close(1003)
                return
            except RecursionError:  # a field that nobody knows, nested too deeply to be skipped
                continue
            if ask.do == "shown":
                self._in_flight = max(0, self._in_flight - 1)
            elif ask.do == "stream":
                self._streams = ask.on
            else:
                self._cursor.want_sightings(ask.on)
            self._make_room()

    def _make_room(self) -> None:
        if self._streams and self._in_flight < IN_FLIGHT:
            self._room.set()
        else:
            self._room.clear()
