"""Limits that inputs and outputs share: bytes of a file, lengths of queues, and seconds of silence."""

FILE_BYTES = 512 << 20  # of a file that is read whole
QUEUE = 10_000  # faults, edits or samples that wait for a reader which does not come: 25 s of an IMU at 400 Hz
TICK_S = 0.5  # longest wait before a stop is noticed
SILENCE_S = 10.0  # for which a device, a recording or a server gives nothing before it does not answer
