"""A viewer of the live page that is no browser: it says only what a test has it say."""

import json
import struct
from contextlib import contextmanager, suppress

from websockets.sync.client import connect


class RawViewer:
    """A viewer without a browser: says only what a test has it say."""

    def __init__(self, socket):
        self.socket = socket
        self.hello = json.loads(socket.recv(timeout=60))

    def say(self, what, on=True):
        self.socket.send(json.dumps({"do": what, "on": on}))

    def update(self, limit_s=60.0):
        message = self.socket.recv(timeout=limit_s)
        length = struct.unpack("<I", message[:4])[0]
        return json.loads(message[4 : 4 + length]) | {"jpeg": message[4 + length :]}

    def drain(self, limit_s):
        """Read on until nothing has come for so long."""
        with suppress(TimeoutError):
            while True:
                self.update(limit_s)


@contextmanager
def raw_viewer(port, query="", stream=False, **options):
    """stream: it asks for updates."""
    with connect(f"ws://127.0.0.1:{port}/api/stream{query}", max_size=None, proxy=None, **options) as socket:
        viewer = RawViewer(socket)
        if stream:
            viewer.say("stream")
        yield viewer
