"""`python -m edgemap.simulation --seed 5 --frames 200 -o DIR`: a rendered drive through a room, with truth."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from edgemap.geometry.errors import EdgemapError


def main() -> int:
    """Parse the arguments, record, and say what was made; known failures are one line and exit code 1."""
    parser = argparse.ArgumentParser(prog="python -m edgemap.simulation", description=__doc__)
    parser.add_argument("--seed", type=int, default=5, help="of the room, the way, and the noise")
    parser.add_argument("--frames", type=int, default=200, help="at 10 Hz")
    parser.add_argument("--images", action="store_true", help="lossless pictures in images/ instead of video.mp4")
    parser.add_argument("-o", "--out", type=Path, required=True, help="folder of the drive")
    options = parser.parse_args()
    from edgemap.simulation.apartment.credits import credits_text
    from edgemap.simulation.record import record

    try:
        made = record(options.seed, options.frames, options.out, video=not options.images)
    except EdgemapError as error:
        print(f"edgemap.simulation: {error}", file=sys.stderr)
        return 1
    command = f"python -m edgemap.simulation --seed {options.seed} --frames {options.frames} -o DIR"
    (options.out / "README.md").write_text(credits_text(made.apartment, command))
    print(f"{options.out}: {options.frames} pictures, {len(made.apartment.furniture)} pieces of furniture")
    return 0


if __name__ == "__main__":
    sys.exit(main())
