"""Why maps go wrong, and what to do: each cause has a section of docs/troubleshooting.md, to which faults lead too."""

import re
from dataclasses import dataclass

PAGE = "docs/troubleshooting.md"


@dataclass(frozen=True, slots=True)
class Cause:
    """title: in a few words. remedy: what to do, in one or two sentences. anchor: of docs/troubleshooting.md."""

    title: str
    remedy: str
    anchor: str

    @property
    def link(self) -> str:
        """Address of the documentation section."""
        return f"{PAGE}#{self.anchor}"


CAUSES = {
    "light": Cause(
        "light or lens: pictures without information",
        "Add light, clean the lens, check the cable; drive slower where pictures are blurred.",
        "light-and-lens",
    ),
    "mount": Cause(
        "the mount's angles are wrong",
        "Run `edgemap calibrate mount`, or pass the angles above with --mount HEIGHT_M,PITCH_DEG (pitch is positive "
        "looking down). Check the grid in mount.jpg: it must lie flat on the floor.",
        "mount",
    ),
    "scale": Cause(
        "the mount's height or the intrinsics are wrong",
        "Measure the lens's height above the floor again and pass --mount HEIGHT_M,PITCH_DEG; if it is right, "
        "calibrate the lens (`edgemap calibrate intrinsics`), or check the wheels' radius.",
        "height-and-intrinsics",
    ),
    "guess": Cause(
        "lens and mount are guesses",
        "Calibrate both (`edgemap calibrate intrinsics`, `edgemap calibrate mount`), or pass --intrinsics and --mount.",
        "height-and-intrinsics",
    ),
    "floor": Cause(
        "no floor, or no object, in view",
        "Tilt the camera down until the floor 1 m ahead is in the picture, and drive past the objects; `edgemap detect "
        "PICTURE --mount H,P` shows which boxes stand on the floor.",
        "no-floor-in-view",
    ),
    "low": Cause(
        "a lens so low that far floor is seen at a grazing angle",
        "Mount the camera higher, or drive nearer to the objects; depth or an IMU helps.",
        "low-camera",
    ),
    "device": Cause(
        "the camera was away",
        "Check cable, USB power and other programs that use the camera.",
        "camera",
    ),
    "wheels": Cause(
        "wheel odometry is missing",
        "Give the wheels' poses (--odometry wheel:FILE.csv, --wheel-topic, or wheel.csv beside pictures) for the whole "
        "drive and by the camera's clock, or an IMU; without either, drive slowly and return to places that were seen "
        "before.",
        "wheels",
    ),
    "drift": Cause(
        "the odometry drifts",
        "Drive slower, return to places that were seen before so that loops close, and check the wheels for slip.",
        "drift",
    ),
    "camera": Cause(
        "a camera unlike those that the network was trained on",
        "Check height, pitch and intrinsics first. If they are right, use the map with care, or train the odometry on "
        "your camera (docs/own-model.md).",
        "other-cameras",
    ),
    "carried": Cause(
        "a camera that is carried, not mounted on a robot",
        "Use a camera with an IMU, or mount it; depth helps most. If it is mounted, check the intrinsics: a wrong "
        "focal length looks the same.",
        "other-cameras",
    ),
    "rate": Cause(
        "too few pictures per second",
        "Deliver 5 pictures per second or more, or drive slower: `edgemap bench` shows what this machine can do.",
        "frame-rate",
    ),
    "other": Cause(
        "objects seen too little",
        "Drive past them once more, nearer and from another side.",
        "doubtful-objects",
    ),
    "output": Cause("an output or the disk fails", "Free the disk, or restart the receiving program.", "outputs"),
}

# Faults as people read them, by the words that they hold; the first that fits.
_FAULTS = (
    (r"mount: height", "scale"),
    (r"mount: |pitch .* given|roll .* given", "mount"),
    (r"camera against wheels|odometry wheel|wheel", "wheels"),
    (r"blind: |picture (dark|blown|covered|blurred|frozen|torn|repeated)", "light"),
    (r"outside what it was trained", "camera"),
    (r"delivers again|lost|no frame|reopen|opened \d|not a picture|skipped|damaged|late|stamp", "device"),
    (r"odometry|imu|gyro|accel", "drift"),
    (r"the run goes on|works again|cannot be written|saved", "output"),
)


def cause_of_fault(text: str) -> Cause | None:
    """The documentation section about a fault; None where there is none."""
    return next((CAUSES[name] for words, name in _FAULTS if re.search(words, text, re.IGNORECASE)), None)
