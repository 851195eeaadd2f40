"""The back end: observations and motions in, pose and map out. It never sees a picture."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.attitude import MountSeen
from edgemap.geometry.camera.floor import FloorCamera
from edgemap.geometry.camera.mount import Mount
from edgemap.geometry.objects.edits import NO_ANNOTATIONS, Annotations, Edit, MapEdits, Zone
from edgemap.geometry.objects.floor_map import FloorMap
from edgemap.geometry.objects.forgetting import Forgetter, NoForgetting
from edgemap.geometry.objects.map_object import MapObject, ObjectMap
from edgemap.geometry.objects.merge import merge_maps
from edgemap.geometry.observations.sighting import PlacedSighting, Sighting
from edgemap.geometry.paper.paper_map import PaperMap
from edgemap.geometry.registration.alignment import Alignment
from edgemap.geometry.se2 import SE2, compose_covariance
from edgemap.runtime.config import Config
from edgemap.runtime.frame_observations import FrameObservations
from edgemap.runtime.loop_closing import LoopCloser, LoopCorrection, NoLoopClosure
from edgemap.runtime.odometry.protocol import FARTHEST_M, Motion, is_covariance
from edgemap.runtime.pose_journal import PoseJournal
from edgemap.runtime.relocalisation import NoRelocalisation, Relocaliser
from edgemap.runtime.timing import Stopwatch

MIN_VARIANCE_M2 = 1e-10  # of an observation: no box is that exact, and its inverse stays finite
MISPLACED_S = 20.0  # of a drive, in which a wrong mount is found out; what is found later is more likely wrong itself
MISPLACING_RAD = math.radians(1.0)  # of a mount's angles: moves what is 3 m before a lens 0.3 m up by half a metre
START_SIGMAS = (0.10, 0.10, math.radians(3.0))  # m, m, rad: how well a person knows where the robot stands


@dataclass(frozen=True, slots=True, eq=False)
class MapUpdate:
    """What one frame changed in the back end.

    sightings: the boxes that stand on the floor, in the map. object_ids: one per sighting. merged: ids of the complete
    run that are no more, to the id that they became part of. pose_covariance: (3, 3) of x, y, yaw: m, m, rad.
    trajectory: all poses so far, as known now. travelled_m: path length by odometry. correction: of a loop closure in
    this step. relocated: in the one update from which on everything is in a saved map's frame, that frame's view of the
    frame before (`pose_map_start`). pose_odom_base, odom_covariance: by odometry alone since the first frame,
    continuous whatever loop closure and relocalisation move (REP-105). annotations: zones and deleted objects.
    """

    sightings: list[PlacedSighting]
    object_ids: list[str]
    merged: dict[str, str]
    pose_map_base: SE2
    pose_covariance: Array
    trajectory: PoseJournal
    travelled_m: float
    stages_ms: dict[str, float]
    pose_odom_base: SE2
    odom_covariance: Array
    correction: LoopCorrection | None = None
    relocated: SE2 | None = None
    annotations: Annotations = NO_ANNOTATIONS


class Mapper:
    """Data association, landmarks, loop closure, relocalisation and forgetting behind one method.

    Depends on what it is given and on nothing else: the same observations make the same map.
    """

    def __init__(
        self,
        object_map: ObjectMap | None = None,
        *,
        config: Config | None = None,
        loop_closer: LoopCloser | NoLoopClosure | None = None,
        forgetter: Forgetter | NoForgetting | None = None,
    ) -> None:
        self.config = config or Config()
        self.map: ObjectMap = object_map or FloorMap(self.config.association)
        self.loop_closer = loop_closer if loop_closer and self.map.movable else NoLoopClosure()
        self.forgetter = forgetter if forgetter and self.map.movable else NoForgetting()
        self.relocaliser: Relocaliser | NoRelocalisation = NoRelocalisation()
        self.edits = MapEdits()
        self._saved_zones: tuple[Zone, ...] = ()  # of a map in which the robot has yet to find itself
        self.trajectory = PoseJournal()
        self.pose_map_base, self.pose_covariance = SE2(), np.zeros((3, 3))
        self.pose_odom_base, self.odom_covariance = SE2(), np.zeros((3, 3))
        self.travelled_m = 0.0
        self._placed_by: Mount | None = None  # the mount that what is mapped was placed by, from a stamp on
        self._placed_from_s = math.inf
        self._started = False
        self._blind: Motion | None = None  # since the last step
        self._watch = Stopwatch()

    def start_in(
        self,
        saved: Sequence[MapObject],
        start: SE2,
        sigmas: Sequence[float] = START_SIGMAS,
        annotations: Annotations = NO_ANNOTATIONS,
    ) -> None:
        """Go on with a saved map from a known pose. sigmas: of the start pose, m, m, rad."""
        self.edits = MapEdits.of(saved, annotations)
        saved = annotations.measured(saved)
        self.map = FloorMap.continued(saved, self.config.association)
        self.pose_map_base, self.pose_covariance = start, np.diag(np.square(sigmas))
        self.loop_closer.begin_in(saved)

    def relocalise_in(self, saved: Sequence[MapObject], annotations: Annotations = NO_ANNOTATIONS) -> None:
        """Make a map of its own until its objects show where in the saved map the robot is, then go on with that one.

        New objects are numbered after the saved ones, so an id means one thing throughout; `merged` tells which of
        them turned out to be saved ones.
        """
        self.edits = MapEdits.of(saved, annotations)
        self._saved_zones = self.edits.take_zones()
        saved = annotations.measured(saved)
        self.relocaliser = Relocaliser(saved, self.config.association, self.config.registration)
        self.map = self.relocaliser.own

    def step(self, observed: FrameObservations) -> MapUpdate:
        """Take in one frame's observations: advance, close loops, associate, forget, relocalise."""
        self._watch.start()
        stage = self._watch.stage
        observed, self._blind = _after(self._blind, _sound(observed)), None
        self._advance(observed.motion)
        self._heed_mount(observed.mount_seen, observed.stamp_s)
        correction, landmarks = self._close_loops(observed)
        stage("closure")
        sightings = [
            sighting.placed(self.pose_map_base, self.pose_covariance, landmark)
            for sighting, landmark in zip(observed.sightings, landmarks, strict=True)
        ]
        object_ids = self.map.update(sightings)
        if observed.searched:
            self.forgetter.observe(
                self.map,
                observed.detections,
                self.pose_map_base,
                object_ids,
                observed.camera,
                self.edits.kept(self.map),
            )
        stage("map")
        update = MapUpdate(
            sightings, object_ids, self.map.merged, self.pose_map_base, self.pose_covariance, self.trajectory,
            self.travelled_m, {}, self.pose_odom_base, self.odom_covariance, correction,
        )  # fmt: skip
        alignment = self.relocaliser.align()
        if alignment is not None:
            update = self._enter_saved_map(update, alignment)
        self.trajectory.append(observed.stamp_s, self.pose_map_base)
        stage("relocalisation")
        return replace(self._as_edited(update), stages_ms=self._watch.stages_ms)

    def step_blind(self, motion: Motion) -> tuple[SE2, Array]:
        """A motion without observations: pose and its covariance (3, 3) after it. The next step takes it in."""
        motion = motion.checked("this")
        self._blind = motion if self._blind is None else _composed(self._blind, motion)
        covariance = compose_covariance(
            self.pose_map_base, self.pose_covariance, self._blind.motion, self._blind.covariance
        )
        return self.pose_map_base @ self._blind.motion, covariance

    def edit(self, edit: Edit) -> str:
        """Take in what a person says of the map, between two steps; the id of its object or zone. Raises EditError.

        Edits are inputs as frames are: the same ones after the same frames make the same map. Pose, trajectory and
        measured objects do not depend on them; a confirmed object is not forgotten.
        """
        return self.edits.take(edit, self.map, self.trajectory.stamps_near)

    def objects(self) -> list[MapObject]:
        """The map as it stands, edits laid over it."""
        return self.edits.shown(self.map)

    def annotations(self) -> Annotations:
        """Zones and deleted objects as they stand."""
        return self.edits.annotations(self.map)

    def _as_edited(self, update: MapUpdate) -> MapUpdate:
        """Ids as people have merged them, and what they have added."""
        merges = self.edits.merges(self.map)
        if merges:
            ids = [merges.get(self.map.shown_as(identity), identity) for identity in update.object_ids]
            update = replace(update, object_ids=ids, merged=update.merged | merges)
        return replace(update, annotations=self.annotations())

    def _advance(self, motion: Motion) -> None:
        """Carry the pose on; the first frame's pose is the map's origin, known exactly."""
        if self._started:
            self.pose_covariance = compose_covariance(
                self.pose_map_base, self.pose_covariance, motion.motion, motion.covariance
            )
            self.pose_map_base = self.pose_map_base @ motion.motion
            self.odom_covariance = compose_covariance(
                self.pose_odom_base, self.odom_covariance, motion.motion, motion.covariance
            )
            self.pose_odom_base = self.pose_odom_base @ motion.motion
            self.travelled_m += math.hypot(motion.motion.x_m, motion.motion.y_m)
        self._started = True

    def _heed_mount(self, seen: MountSeen | None, stamp_s: float) -> None:
        """Forget what was placed by a mount that has soon proved wrong: it stands elsewhere, and is seen again."""
        if seen is None or not self.map.movable:
            return
        if self._placed_by is None:
            self._placed_by, self._placed_from_s = seen.used, stamp_s
        turned = np.subtract(
            (seen.used.roll_rad, seen.used.pitch_rad), (self._placed_by.roll_rad, self._placed_by.pitch_rad)
        )
        if np.abs(turned).max() > MISPLACING_RAD:
            if stamp_s - self._placed_from_s < MISPLACED_S:
                self.map.forget_run(self.edits.kept(self.map))
            self._placed_by = seen.used

    def _close_loops(self, observed: FrameObservations) -> tuple[LoopCorrection | None, list[int]]:
        """Where landmarks observed again tell how far the pose has drifted, pose, trajectory and map move."""
        correction, landmarks = self.loop_closer.observe(self.pose_map_base, self.pose_covariance, observed)
        if correction is not None:
            self.pose_map_base, self.pose_covariance = correction.pose_map_base, correction.pose_covariance
            self.trajectory.correct(correction.past)
            self.map.moved(correction.past, correction.landmarks)
            self.edits.moved(correction.past)
        return correction, landmarks

    def _enter_saved_map(self, update: MapUpdate, alignment: Alignment) -> MapUpdate:
        """Both maps become one, and the robot and this frame's sightings move into the saved one's frame."""
        merged, became = merge_maps(self.relocaliser.saved, self.map.objects(), alignment, self.config.association)
        self.map = FloorMap.continued(merged, self.config.association, before=self.relocaliser.own, merged=became)
        self.pose_covariance = compose_covariance(
            alignment.pose_a_b, alignment.covariance, self.pose_map_base, self.pose_covariance
        )
        self.pose_map_base = alignment.pose_a_b @ self.pose_map_base
        self.loop_closer.begin_in(merged)
        self.trajectory.transform(alignment.pose_a_b)
        self.edits.enter(self._saved_zones, alignment)
        pose, covariance = self.pose_map_base, self.pose_covariance
        return replace(
            update,
            sightings=[placed.sighting.placed(pose, covariance) for placed in update.sightings],
            object_ids=[became.get(identity, identity) for identity in update.object_ids],
            merged=self.map.merged,
            pose_map_base=pose,
            pose_covariance=covariance,
            relocated=alignment.pose_a_b,
        )


def new_mapper(
    config: Config,
    clustering: str = "default",
    odometry: str = "hybrid",
    loop_closure: bool = True,
    forgets: FloorCamera | None = None,
) -> Mapper:
    """An empty back end; where poses are given it closes no loops. clustering: default or paper. forgets: the camera by
    whose view objects that are gone leave the map."""
    given = odometry == "truth" or odometry.endswith(".tum")
    return Mapper(
        PaperMap() if clustering == "paper" else None,
        config=config,
        loop_closer=LoopCloser(config.loop_closure) if loop_closure and not given else None,
        forgetter=Forgetter(forgets, config.forgetting) if forgets else None,
    )


def _composed(first: Motion, second: Motion) -> Motion:
    """Two motions, one after the other, as one."""
    covariance = compose_covariance(first.motion, first.covariance, second.motion, second.covariance)
    fault = "; ".join(dict.fromkeys(filter(None, (first.fault, second.fault))))
    return Motion(first.motion @ second.motion, covariance, fault, first.blind or second.blind)


def _sound(observed: FrameObservations) -> FrameObservations:
    """The observations that can be: no NaN, no infinity and no covariance that is none ever reaches pose or map."""
    sightings = [sighting for sighting in observed.sightings if _is_sound(sighting)]
    return replace(observed, sightings=sightings, motion=observed.motion.checked("this"))


def _is_sound(sighting: Sighting) -> bool:
    own_m2, shared_m2, place_m = sighting.covariance_m2, sighting.shared_m2, sighting.position_base_m.tolist()
    sizes = sighting.score, sighting.width_m, sighting.height_m, sighting.stamp_s
    if not all(map(math.isfinite, (*sizes, *place_m, *own_m2.ravel().tolist(), *shared_m2.ravel().tolist()))):
        return False
    ((xx, xy), (_, yy)), ((shared_xx, _), (_, shared_yy)) = own_m2.tolist(), shared_m2.tolist()
    return (
        is_covariance(own_m2)
        and is_covariance(shared_m2)
        and xx * yy - xy * xy > MIN_VARIANCE_M2 * (xx + yy)  # so the smaller eigenvalue is above it
        and xx + yy + shared_xx + shared_yy < FARTHEST_M**2
        and math.hypot(*place_m) < FARTHEST_M
    )


def _after(blind: Motion | None, observed: FrameObservations) -> FrameObservations:
    return observed if blind is None else replace(observed, motion=_composed(blind, observed.motion))
