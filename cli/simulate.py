"""`edgemap simulate`: drives through rendered homes, with their truth."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from edgemap.cli.arguments import arg
from edgemap.cli.camera_options import MountText, read_mount
from edgemap.cli.options import at_least
from edgemap.runtime.frames.errors import UsageError
from edgemap.runtime.frames.extras import need

if TYPE_CHECKING:
    from edgemap.simulation.world import Choices


@dataclass(frozen=True)
class DriveOptions:
    """Home, camera and robot of a drive."""

    rate: Annotated[float, arg(metavar="HZ", help="Pictures per second.")] = 10.0
    mount: MountText = None
    light: Annotated[
        Literal["day", "lamp", "mixed", "dim", "changing"] | None, arg(help="Drawn from the seed by default.")
    ] = None
    people: Annotated[int | None, arg(metavar="N", help="People walking about; drawn by default.")] = None
    moved: Annotated[
        int,
        arg(
            metavar="K",
            help="Another drive through the same home after K of its pieces were removed and K put elsewhere: "
            "moved.json says which, and where in the first drive's map the new one starts.",
        ),
    ] = 0
    nodding: Annotated[
        bool, arg(help="The robot nods as it speeds up and brakes, and over thresholds and carpets; poses have 6 DoF.")
    ] = False
    imu: Annotated[bool, arg(help="Samples of an IMU too, 200 a second, with the errors of a BMI055: imu.csv.")] = False
    plain: Annotated[
        bool,
        arg(
            help="The demo's camera: a lens without distortion, 0.60 m up and 11.5 deg down, a sharp picture without "
            "noise, by day, nobody about."
        ),
    ] = False

    def choices(self) -> "Choices":
        """What is not drawn from the seed. Raises UsageError."""
        from edgemap.simulation.camera.film import CameraSetup
        from edgemap.simulation.world import PLAIN, Choices

        given = {"mount": read_mount(self.mount, CameraSetup().mount)} if self.mount is not None else {}
        given |= {name: value for name in ("light", "people") if (value := getattr(self, name)) is not None}
        own = {"moved": self.moved, "rate_hz": self.rate, "nodding": self.nodding, "imu": self.imu}
        return replace(PLAIN if self.plain else Choices(), **own, **given)


def command(
    drive: Annotated[DriveOptions, arg(name="Drive")],
    out: Annotated[Path, arg(aliases=["-o"], metavar="DIR", help="The folder; one that was stopped goes on.")],
    seed: Annotated[int, arg(metavar="N", help="Of the home, the drive, the camera and the light.")] = 0,
    frames: Annotated[int, arg(metavar="N", help="Pictures, at --rate.")] = 450,
    video: Annotated[bool, arg(help="One compact video.mp4, not pictures.")] = False,
    depth: Annotated[bool, arg(help="Depth pictures too: 16 bits, millimetres.")] = False,
    floor_labels: Annotated[
        int | None,
        arg(
            metavar="N",
            help="Labels of every N-th picture too: floor/NAME.png, 1 floor, 2 wall, 0 other, as `eval floor` reads "
            "them; also beside a drive that was rendered without.",
        ),
    ] = None,
    locobot: Annotated[
        bool, arg(help="The LoCoBot data set instead: 5,000 training pictures and four drives of 2,000.")
    ] = False,
    pictures: Annotated[
        int | None,
        arg(metavar="PER_HOME", help="Unrelated pictures for training a detector instead, from --seeds."),
    ] = None,
    close: Annotated[
        float, arg(metavar="SHARE", help="Of --pictures, taken before walls and furniture: little or no floor in view.")
    ] = 0.0,
    carried: Annotated[
        bool, arg(help="Of --pictures: by a camera that a person carries, 1.2 to 1.75 m up, looking down.")
    ] = False,
    seeds: Annotated[
        str | None,
        arg(
            metavar="A:B",
            help="Homes from seed A up to, not including, B: --pictures of each, else a drive DIR/SEED of each.",
        ),
    ] = None,
    shard: Annotated[
        str | None,
        arg(
            metavar="I/N",
            help="Only every N-th home of --seeds, from the I-th (1 to N) on: one machine's part of a farm.",
        ),
    ] = None,
) -> None:
    """Render a robot's drive through a furnished home, with poses, boxes, objects and wheel odometry.

    Everything follows from the seed: home, way, lens, mount, light, people. The folder is one for `--data drive:DIR`
    and `--camera drive:DIR`; `sim:SEED` renders the same drive live. A longer drive begins with the shorter one.
    """
    import shlex
    import sys

    from tqdm import tqdm

    from edgemap.simulation.live import RENDERERS

    need("simulation", "edgemap simulate", (*RENDERERS, "av") if video else RENDERERS)
    at_least(1, frames=frames, pictures=pictures, floor_labels=floor_labels)
    if floor_labels is not None and (video or locobot or pictures is not None):
        raise UsageError("--floor-labels is for drives of single pictures; --pictures has them always")
    if not 0.0 <= close <= 1.0 or (close and pictures is None):
        raise UsageError(f"--close {close:g}: expected 0 to 1, a share of --pictures")
    if carried and pictures is None:
        raise UsageError("--carried is for --pictures")
    at_least(0, people=drive.people, seed=seed, moved=drive.moved)
    if not 1.0 <= drive.rate <= 120.0:
        raise UsageError(f"--rate {drive.rate:g}: expected 1 to 120 pictures per second")
    typed = "edgemap simulate " + shlex.join(sys.argv[2:])
    with tqdm(unit=" pictures", disable=None) as bar:

        def progress(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        if pictures is not None:
            from edgemap.simulation.pictures import render_pictures

            render_pictures(out, pictures, homes_of(seeds, shard), progress, typed, close, carried)
        elif locobot:
            from edgemap.simulation.locobot import record_locobot

            record_locobot(out, seed, progress, command=typed)
        else:
            from edgemap.simulation.record import label_drive, record
            from edgemap.simulation.world import draw_world

            chosen = drive.choices()
            for home in [seed] if seeds is None else homes_of(seeds, shard):
                world = draw_world(home, frames, chosen)
                folder = out if seeds is None else out / str(home)
                record(world, folder, video=video, depth=depth, progress=progress, command=typed)
                if floor_labels is not None:
                    label_drive(world, folder, floor_labels)
    if seeds is not None and pictures is None:
        print(f"{out}: done; use its folders as --data drive:{out}/SEED")
        return
    kind = "yolo" if pictures is not None else "drive"
    print(f"{out}: done" if locobot else f"{out}: done; use it as --data {kind}:{out}")


def homes_of(text: str | None, shard: str | None) -> range:
    """The homes of `--seeds A:B` that `--shard I/N` takes. Raises UsageError."""
    first, colon, last = (text or "").partition(":")
    if not (colon and first.isdecimal() and last.isdecimal() and int(first) < int(last)):
        raise UsageError(f"--seeds {text!r}: expected A:B, homes from A up to, not including, B")
    part, slash, parts = ("1/1" if shard is None else shard).partition("/")
    if not (slash and part.isdecimal() and parts.isdecimal() and 1 <= int(part) <= int(parts)):
        raise UsageError(f"--shard {shard!r}: expected I/N with I from 1 to N")
    homes = range(int(first) + int(part) - 1, int(last), int(parts))
    if not homes:
        raise UsageError(f"--shard {shard}: no home of {text} is left for it")
    return homes
