"""A network camera on this machine: RTSP (RFC 2326) with JPEG over RTP (RFC 2435) in the same TCP connection."""

import socketserver
import struct
import time

import cv2
import numpy as np
from support.mjpeg import MjpegServer

PACKET_BYTES = 1400
SDP = "v=0\r\no=- 0 0 IN IP4 127.0.0.1\r\ns=test\r\nt=0 0\r\nm=video 0 RTP/AVP 26\r\na=control:track0\r\n"


class RtspServer(MjpegServer):
    """Serves `pictures`, whose sides are multiples of 8 px."""

    address = "rtsp://127.0.0.1:{}/live"

    def __init__(self, pictures):
        # Sampling 4:2:0, RTP's type 1; the standard Huffman tables, which OpenCV writes.
        options = [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420]
        self.packed = [taken_apart(cv2.imencode(".jpg", image, options)[1].tobytes()) for image in pictures]
        self.size = pictures[0].shape[1::-1]
        super().__init__(pictures=pictures)

    def handler(self):
        camera = self

        class Handler(socketserver.StreamRequestHandler):
            def handle(self):
                camera.connections += 1
                server = camera._server
                try:
                    while (line := self.rfile.readline()) and camera._server is server:
                        headers = {}
                        while text := self.rfile.readline().strip().decode():
                            headers[text.partition(":")[0].lower()] = text.partition(":")[2].strip()
                        method = line.split()[0].decode()
                        self.wfile.write(answer(method, headers).encode())
                        if method == "PLAY":
                            self.play(server)
                except OSError:
                    pass

            def play(self, server):
                count, began_s = 0, time.monotonic()
                for number in range(1 << 30):
                    if camera._server is not server:
                        return
                    clock = int((time.monotonic() - began_s) * 90_000)
                    for packet in rtp(camera.packed[number % len(camera.packed)], camera.size, clock, count):
                        count += 1
                        self.wfile.write(b"$\x00" + struct.pack(">H", len(packet)) + packet)
                    time.sleep(camera.period_s)

        return Handler


def answer(method, headers):
    """What the server says; a client that wants UDP is told that there is none, and asks for TCP."""
    status, more, body = "200 OK", "", ""
    if method == "OPTIONS":
        more = "Public: OPTIONS, DESCRIBE, SETUP, PLAY, TEARDOWN\r\n"
    elif method == "DESCRIBE":
        more, body = f"Content-Type: application/sdp\r\nContent-Length: {len(SDP)}\r\n", SDP
    elif method == "SETUP":
        if "RTP/AVP/TCP" in headers.get("transport", ""):
            more = "Transport: RTP/AVP/TCP;unicast;interleaved=0-1\r\nSession: 1\r\n"
        else:
            status = "461 Unsupported Transport"
    elif method == "PLAY":
        more = "Session: 1\r\nRange: npt=0-\r\n"
    return f"RTSP/1.0 {status}\r\nCSeq: {headers.get('cseq', '0')}\r\n{more}\r\n{body}"


def taken_apart(jpeg):
    """(quantisation tables, entropy-coded data) of a baseline JPEG."""
    tables, at = b"", 2
    while True:
        marker, length = jpeg[at + 1], struct.unpack(">H", jpeg[at + 2 : at + 4])[0]
        part = jpeg[at + 4 : at + 2 + length]
        at += 2 + length
        while marker == 0xDB and part:
            tables, part = tables + part[1:65], part[65:]
        if marker == 0xDA:
            return tables, jpeg[at:-2]


def rtp(jpeg, size, clock, sequence):
    """RTP packets of one picture. clock: 90 kHz."""
    tables, data = jpeg
    for offset in range(0, len(data), PACKET_BYTES):
        part = data[offset : offset + PACKET_BYTES]
        last = offset + PACKET_BYTES >= len(data)
        head = struct.pack(">BBHII", 0x80, 26 | (0x80 if last else 0), (sequence & 0xFFFF), clock & 0xFFFFFFFF, 1)
        head += struct.pack(">I", offset) + bytes([1, 255, size[0] // 8, size[1] // 8])
        if offset == 0:
            head += struct.pack(">BBH", 0, 0, len(tables)) + tables
        sequence += 1
        yield head + part


def gradients(count=20, size=(64, 48)):
    """Smooth pictures, which JPEG keeps, each with a grey of its own in the middle."""
    ramp = np.tile(np.linspace(0, 255, size[0], dtype=np.uint8), (size[1], 1))
    pictures = [np.dstack([ramp, ramp[:, ::-1], np.full_like(ramp, 10 * number)]) for number in range(count)]
    return [np.ascontiguousarray(picture) for picture in pictures]
