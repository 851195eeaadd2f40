"""A picture of any size that is small as a file."""

import functools
import struct
import zlib


@functools.cache
def png(width, height):
    """A black picture, small as a file."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    packer = zlib.compressobj(9, wbits=-zlib.MAX_WBITS)
    row = packer.compress(bytes(1 + 3 * width)) + packer.flush(zlib.Z_FULL_FLUSH)  # the same bytes for each row
    sum_of_zeros = struct.pack(">HH", height * (1 + 3 * width) % 65521, 1)  # Adler-32
    rows = b"\x78\xda" + row * height + zlib.compressobj(wbits=-zlib.MAX_WBITS).flush() + sum_of_zeros
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")
