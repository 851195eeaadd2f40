"""An MCAP recording as a camera: every picture of one topic, in order, with the calibration in the file."""

import math
from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack, closing, suppress
from dataclasses import replace
from itertools import chain, islice
from typing import Any

from edgemap.bridges.ros2.messages.definitions import to_s
from edgemap.bridges.ros2.messages.tf_chain import PATH
from edgemap.bridges.ros2.messages.topics import DEPTH, EDITS, IMU, SEARCHED, STAMPS, TF
from edgemap.bridges.ros2.recordings import foreign
from edgemap.bridges.ros2.recordings.facts import RECORD, TRUTH_FILE, WHEEL_FILE, read_facts, read_trajectory_file
from edgemap.bridges.ros2.recordings.pictures import PICTURE_KINDS, depth_beside, kind_of_pictures
from edgemap.bridges.ros2.recordings.reader import open_reading
from edgemap.bridges.ros2.recordings.reading import Reading
from edgemap.bridges.ros2.recordings.tf_poses import tf_poses
from edgemap.geometry.camera.mount import Mount
from edgemap.runtime.frames.camera import CameraInfo, CameraOptions, FileCamera, Picture, Pictures
from edgemap.runtime.frames.errors import CameraError, CameraFault
from edgemap.runtime.frames.faults import FaultKind
from edgemap.runtime.frames.reading import printable, user_path
from edgemap.runtime.inputs.drives.pictures import DepthBeside, Levels
from edgemap.runtime.motion.given_poses import GivenPoses
from edgemap.runtime.step.pose_journal import SAME_S

INFO_KIND, TF_KIND = "sensor_msgs/CameraInfo", "tf2_msgs/TFMessage"
USABLE = "colour", "infrared"  # kinds of pictures, the first that there is


def recording_camera(spec: str, how: CameraOptions = CameraOptions()) -> FileCamera:  # noqa: B008
    """`FILE.mcap` or `FILE.mcap#/topic`: ours, or a bag of ROS, a file or its folder; without a topic its first one
    with colour pictures, else with infrared ones.

    how: its topics are those of the file, in place of those that would be read. depth: whether frames bring the depth
    that edgemap recorded, or that a bag has aligned to the colour picture.
    Stamps are the pictures' headers', or the time of recording where all of those are zero. A file that was cut off
    gives every complete picture and then a CameraError that says so. Raises CameraError.
    """
    file, _, topic = spec.partition("#")
    path = user_path(file)
    if not path.exists():
        raise CameraError(f"{path}: no such file")
    with ExitStack() as resources:
        recording = resources.enter_context(closing(open_reading(path)))
        ours, wanted, levels = RECORD in recording.metadata, how.topics.depth, Levels()
        topic, kinds = _choose(recording, topic, (DEPTH if ours else None, wanted))
        beside, depth = (depth_beside(recording, wanted) if how.depth else None) or (None, None)
        ahead = list[Picture | CameraFault]()
        for picture in (pictures := _pictures(recording, topic, printable(spec), levels, depth)):
            ahead.append(picture)
            if isinstance(picture, Picture):
                break
        else:
            why = f", {len(ahead):,} damaged: {ahead[0]}" if ahead else ""
            raise CameraError(f"{path}: {topic} has no complete picture{why}")
        (height, width), first_s = picture.image.shape[:2], picture.stamp_s

        def tf(frames: str, mount: Mount) -> GivenPoses:
            """The base's poses by the tf of the whole file, from its first picture on."""
            with closing(open_reading(path)) as again:
                return tf_poses(again, frames, mount, first_s)

        if ours:
            info = _recorded(recording, topic, how)
        else:
            info = _foreign(recording, topic, how, (width, height), levels, kinds, beside)
        if how.topics.wheels:
            info = replace(info, wheel=foreign.wheels_of(recording, how.topics.wheels))
        count, poses = recording.topics[topic].count, tf if TF in recording.topics else None
        info = replace(info, name=spec, size=(width, height), frame_count=count, tf=poses)
        return FileCamera(info, chain(ahead, pictures), resources.pop_all().close)


def _choose(recording: Reading, topic: str, others: Collection[str | None]) -> tuple[str, dict[str, str]]:
    """The topic with pictures that is asked for, or the first usable one, and the kinds of pictures by topic, where
    they were compared. others: topics with depth."""
    pictures = [name for name in recording.topics_of(*PICTURE_KINDS) if name not in others]
    if topic in pictures:
        return topic, {}
    kinds = dict.fromkeys(pictures, USABLE[0])
    if len(pictures) > 1:
        kinds = {name: _kind(recording, name) for name in pictures}
    usable = [name for name in pictures if kinds[name] in USABLE]
    if usable and not topic:
        return min(usable, key=lambda name: USABLE.index(kinds[name])), kinds
    has = ", ".join(usable) or "none"
    if topic in recording.topics:
        kind = recording.topics[topic].kind or "untyped"
        raise CameraError(f"{recording.path}: {topic} is {kind}, not pictures (topics with pictures: {has})")
    if topic:
        raise CameraError(f"{recording.path}: no topic {topic} (topics with pictures: {has})")
    there = ", ".join(f"{name} ({kinds.get(name, found.kind)})" for name, found in recording.topics.items())
    raise CameraError(
        f"{recording.path}: no topic with sensor_msgs Image or CompressedImage of colour or grey; has "
        f"{there or 'no messages at all'}"
    )


def _kind(recording: Reading, topic: str) -> str:
    try:
        return kind_of_pictures(topic, recording.first(topic))
    except CameraError:
        return "damaged"


def _pictures(recording: Reading, topic: str, name: str, levels: Levels, depth: DepthBeside | None) -> Pictures:
    """All pictures in order, with a fault in place of each that is dropped, and one before the first after the clock
    was set. Raises CameraError for damage, and at the end of a file cut off."""
    exact, unsearched, read = dict[int, float](), set[int](), PICTURE_KINDS[recording.topics[topic].kind]
    if RECORD in recording.metadata:
        exact, unsearched = _exact_stamps(recording), _unsearched(recording)
    count, last_s, size = 0, -math.inf, None
    for stamp_ns, own_ns, message, fault in recording.samples(topic):
        where = f"{name}#{count}"
        if fault:
            yield CameraFault(FaultKind.CLOCK, f"{where}: {fault}")
        if stamp_ns is None:
            continue
        try:
            image = read(message, f"{name} picture {count}", levels)
        except CameraError as error:
            yield CameraFault(FaultKind.DAMAGED, f"{error}, skipped")
            continue
        stamp_s = exact.get(own_ns, to_s(stamp_ns)) if stamp_ns == own_ns else to_s(stamp_ns)
        height, width = image.shape[:2]
        size = size or (width, height)
        if stamp_s < last_s:  # a float may be the same for two nanoseconds
            yield CameraFault(FaultKind.CLOCK, f"{where}: at {stamp_s:.6f} s, not after {last_s:.6f} s, skipped")
        elif (width, height) != size:
            text = f"{where}: picture is {width}x{height}, not as those before, skipped"
            yield CameraFault(FaultKind.SIZE, text)
        else:
            yield Picture(stamp_s, image, depth and depth.at(stamp_ns), where, own_ns not in unsearched)
            count, last_s = count + 1, stamp_s
    if count and not recording.complete:
        raise CameraError(f"{recording.path}: cut off, the {count} complete pictures before it were read")


def _recorded(recording: Reading, topic: str, how: CameraOptions) -> CameraInfo:
    """Lens, mount, rate, truth, wheels and IMU as edgemap wrote them."""
    info, imu = read_facts(recording.metadata[RECORD], f"{recording.path}"), None
    if how.topics.imu is not None:
        frame_id = recording.first(topic).header.frame_id
        imu = foreign.imu_of(recording, foreign.tf_of(recording), frame_id, how.topics.imu)[1]
    elif IMU in recording.topics:
        imu = foreign.read_imu(recording, IMU)
    truth, wheel = recording.attachments.get(TRUTH_FILE), None
    if how.topics.wheels is None and WHEEL_FILE in recording.attachments:
        wheel = foreign.wheels_of(recording)
    return replace(
        info,
        intrinsics=how.intrinsics or info.intrinsics,
        mount=how.mount or info.mount,
        edits=tuple(str(line) for _, line in _values(recording, EDITS)),
        imu=imu,
        wheel=wheel,
        truth=None if truth is None else read_trajectory_file(truth, f"{recording.path}: {TRUTH_FILE}"),
    )


def _foreign(
    recording: Reading,
    topic: str,
    how: CameraOptions,
    size: tuple[int, int],
    levels: Levels,
    kinds: Mapping[str, str],
    depth: str | None,
) -> CameraInfo:
    """Lens, mount, rate and IMU from CameraInfo and tf, and what was taken and what was not as notes. size: of the
    pictures, px. kinds: of pictures, by topic, where they are known. depth: its topic."""
    lens, info = how.intrinsics, None
    if lens is None and (info := _info_topic(recording, topic)):
        lens = foreign.lens_of(recording.first(info), topic, f"{recording.path}", size)
    tree, frame_id = foreign.tf_of(recording), recording.first(topic).header.frame_id
    mount, text = foreign.mount_of(tree, frame_id, how.rotate) if how.mount is None else (how.mount, "")
    imu_topic, imu = foreign.imu_of(recording, tree, frame_id, how.topics.imu)
    pictures = f"{recording.topics[topic].count} pictures" + (", infrared" if kinds.get(topic) == "infrared" else "")
    uses = {imu_topic: "IMU", how.topics.wheels: "wheels", info if lens else None: "lens", depth: "depth"}
    uses |= {name: "tf" for name, known in recording.topics.items() if known.kind == TF_KIND}
    uses |= {name: "path, for --odometry tf" for name, known in recording.topics.items() if known.kind == PATH}
    uses |= {topic: pictures}
    taken = [f"{name} ({uses[name]})" for name in recording.topics if name in uses]
    left = [f"{name} ({_unused(recording, name, kinds)})" for name in recording.topics if name not in uses]
    lines = [f"{title}: " + ", ".join(some) for title, some in (("taken", taken), ("not taken", left)) if some]
    notes = (*lines, *([text] if text else []), *levels.notes)
    return CameraInfo("", intrinsics=lens, mount=mount, rate_hz=_rate_hz(recording, topic), imu=imu, notes=notes)


def _unused(recording: Reading, name: str, kinds: Mapping[str, str]) -> str:
    """Why a topic was not taken, or how it is."""
    known = recording.topics[name]
    if not known.count:
        return "no messages"
    if known.kind in PICTURE_KINDS:
        kind = kinds.get(name, "pictures")
        return f"depth; --topics depth={name}" if kind == "depth" else f"{kind}; #{name}"
    reasons = {
        foreign.WHEEL_KIND: f"--topics wheels={name}",
        foreign.IMU_KIND: "tf does not join it to the pictures, or another is used",
    }
    return reasons.get(known.kind, known.kind)


def _info_topic(recording: Reading, topic: str) -> str | None:
    """The CameraInfo beside the pictures (image_transport's custom), or the only one in the file; else None."""
    infos = recording.topics_of(INFO_KIND)
    beside = [name for name in foreign.info_topics(topic) if name in infos]
    return next(iter(beside or (infos if len(infos) == 1 else [])), None)


def _rate_hz(recording: Reading, topic: str) -> float | None:
    """From the first pictures' times of recording."""
    times = list[int]()
    with suppress(CameraError):  # of a damaged one; the camera reports it in its place
        times.extend(log_ns for log_ns, _ in islice(recording.messages(topic), 30))
    span_s = to_s(times[-1] - times[0]) if times else 0.0
    return (len(times) - 1) / span_s if span_s > 0 else None


def _values(recording: Reading, topic: str) -> Iterator[tuple[int, Any]]:
    """Log time in ns and value of each std_msgs message of a topic; none where there is no such topic."""
    messages = recording.messages(topic) if topic in recording.topics else ()
    return ((log_ns, message.data) for log_ns, message in messages)


def _unsearched(recording: Reading) -> set[int]:
    """Stamps of the pictures that a budget did not have searched, ns."""
    return {log_ns for log_ns, searched in _values(recording, SEARCHED) if float(searched) == 0.0}


def _exact_stamps(recording: Reading) -> dict[int, float]:
    """Stamps that are finer than a nanosecond, by their nearest one."""
    stamps = {log_ns: float(stamp_s) for log_ns, stamp_s in _values(recording, STAMPS)}
    if wrong := [ns for ns, stamp_s in stamps.items() if not abs(stamp_s - to_s(ns)) < SAME_S]:
        raise CameraError(f"{recording.path}: {STAMPS} says {stamps[wrong[0]]} s at {to_s(wrong[0]):.9f} s")
    return stamps
