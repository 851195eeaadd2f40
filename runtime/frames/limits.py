"""Limits that inputs and outputs share: bytes and values of a file, lengths of queues, and seconds of silence."""

FILE_BYTES = 256 << 20  # of a file or an answer that is read whole
VALUES = 8_000_000  # of a JSON document, each up to 64 bytes of memory; half as many lines of a table of numbers
LINE = 1000  # characters of a table's line, and of one that is printed
QUEUE = 10_000  # faults, edits or samples that wait for a reader which does not come: 25 s of an IMU at 400 Hz
TICK_S = 0.5  # longest wait before a stop is noticed
LOWEST_M, HIGHEST_M = 0.05, 3.0  # of a lens above the floor that is guessed, measured or typed
EVERY_S = 1.0  # between two reports, of stream or clock, of what changes slowly: nobody needs more
SELDOM_S = 10.0  # between two reports of one lasting condition, and between two messages that cost much
PATIENCE_S = 2.0  # for which a start, an end or a read waits for another program or a device
SILENCE_S = 10.0  # for which a device, a recording or a server gives nothing before it does not answer
