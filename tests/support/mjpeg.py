"""A network camera on this machine: MJPEG over HTTP, which can be stalled, cut, and taken off the network."""

import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import cv2
import numpy as np


class MjpegServer:
    """Serves noise, or `pictures` round and round, at `rate_hz`, from an address that stays the same, until `stop`."""

    address = "http://127.0.0.1:{}/video.mjpg"

    def __init__(self, rate_hz=20.0, size=(64, 48), pictures=None):
        random = np.random.default_rng(0)
        images = pictures or [random.integers(0, 256, (size[1], size[0], 3), dtype=np.uint8) for _ in range(20)]
        self.jpegs = [cv2.imencode(".jpg", image)[1].tobytes() for image in images]
        self.period_s, self.stalled, self.connections, self.sent = 1.0 / rate_hz, False, 0, 0
        self._server = None
        self.port = 0
        self.start()

    @property
    def url(self):
        return self.address.format(self.port)

    def handler(self):
        """What answers one client, for as long as the server that it had at first."""
        camera = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self):
                camera.connections += 1
                server = camera._server
                self.send_response(200)
                self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
                self.end_headers()
                try:
                    while camera._server is server is not None:
                        if not camera.stalled:
                            jpeg = camera.jpegs[camera.sent % len(camera.jpegs)]
                            camera.sent += 1
                            head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(jpeg)}\r\n\r\n"
                            self.wfile.write(head.encode() + jpeg + b"\r\n")
                        time.sleep(camera.period_s)
                except OSError:
                    pass

            def log_message(self, *_):
                pass

        return Handler

    def start(self):
        self._server = server = ThreadingHTTPServer(("127.0.0.1", self.port), self.handler())
        server.daemon_threads = True
        self.port = server.server_port
        threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()

    def stop(self):
        server, self._server = self._server, None
        if server is not None:
            server.shutdown()
            server.server_close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.stop()
