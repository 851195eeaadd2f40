"""The back end: observations and motions in, pose and map out. It never sees a picture."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from edgemap.geometry.arrays import Array
from edgemap.geometry.camera.attitude import MountEstimate
from edgemap.geometry.errors import MapError
from edgemap.geometry.grid.floor_scan import FloorScan
from edgemap.geometry.grid.fusion import GridFusion
from edgemap.geometry.grid.occupancy_grid import OccupancyGrid
from edgemap.geometry.map_object import REPEATED, MapObject
from edgemap.geometry.objects.annotations import NO_ANNOTATIONS, Annotations
from edgemap.geometry.objects.events import Edit, EditError, MapEvents
from edgemap.geometry.objects.floor_map import FloorMap
from edgemap.geometry.objects.forgetting import Forgetter, is_crossed
from edgemap.geometry.objects.merge import merge_maps
from edgemap.geometry.observations.detections import mover_boxes
from edgemap.geometry.observations.sighting import PlacedSighting, Sighting
from edgemap.geometry.paper.paper_map import PaperMap
from edgemap.geometry.registration.alignment import Alignment
from edgemap.geometry.se2 import SE2, compose_covariance
from edgemap.runtime.frames.limits import EVERY_S
from edgemap.runtime.frames.timing import Stopwatch, StreamTimer
from edgemap.runtime.motion.odometry.protocol import FARTHEST_M, Motion, is_covariance
from edgemap.runtime.step.config import Config
from edgemap.runtime.step.frame_observations import FrameObservations
from edgemap.runtime.step.map_memory import MapMemory
from edgemap.runtime.step.pose_journal import PoseJournal
from edgemap.runtime.step.relocalisation import Relocaliser, SavedMap

# That evidence is counted in: thresholds were chosen at 10 Hz. One picture stands for `REPEATED` of them at most.
PICTURE_S = 0.1
WIDEST_M = 50.0  # that a map becomes by what somebody states: homes are smaller, and memory grows with its square
START_SIGMAS = (0.10, 0.10, math.radians(3.0))  # m, m, rad: how well a person knows where the robot stands


@dataclass(frozen=True, slots=True, eq=False)
class LoopCorrection:
    """A loop closure's result. moved_m: correction of this frame's pose. links: number of landmarks matched to earlier
    ones so far."""

    moved_m: float
    links: int


@dataclass(frozen=True, eq=False, kw_only=True)
class MapUpdate:
    """The back end's update by one frame. sightings: the boxes that stand on the floor, in the map. object_ids: one per
    sighting. merged: retired ids of the run so far, each with the id of the object that replaced it. pose_covariance:
    (3, 3) of x, y, yaw: m, m, rad. trajectory: current estimates of all poses so far. travelled_m: path length by
    odometry. correction: of a loop closure in this step. relocated: pose of the old map frame in the saved map's frame;
    set only in the update that switches frames. pose_odom_base, odom_covariance: by odometry alone since the first
    frame, continuous whatever loop closure and relocalisation move (REP-105). annotations: zones and deleted objects.
    grid: at most one stream second old; None before the first floor. floor_scan: of this frame's picture, where the
    grid took it in. scale: see `FrameObservations`; a saved map is `scale` times as large as this one. 1 where an
    earlier map is continued. at: wall time, seconds since 1970; None where unknown.
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
    grid: OccupancyGrid | None = None
    floor_scan: FloorScan | None = None
    scale: float = 1.0
    at: float | None = None


class Mapper:
    """Data association, landmarks, loop closure, relocalisation and forgetting behind one method.

    Depends on its inputs only: the same observations make the same map. paper: the objects by the paper's clustering,
    which are the map then; its sightings stay where they were placed, so no loops are closed, no object is forgotten,
    and people edit zones and the dock only. forgetter: None where objects never leave the map. relocaliser: None
    without a saved map that was entered at an unknown pose.
    """

    def __init__(
        self,
        *,
        config: Config | None = None,
        paper: PaperMap | None = None,
        closes_loops: bool = False,
        forgetter: Forgetter | None = None,
    ) -> None:
        self.config = config or Config()
        self.map, self.paper = FloorMap(self.config.association, self.config.loop_closure), paper
        self.closes_loops = closes_loops and paper is None
        self.forgetter = forgetter if paper is None else None
        self.relocaliser: Relocaliser | None = None
        self.grid = GridFusion(self.config.grid)
        self._shown_grid: OccupancyGrid | None = None
        self._shown_timer = StreamTimer(EVERY_S)
        self.edits, self.memory = MapEvents(), MapMemory()
        self._continued: SavedMap | None = None  # from a stated pose
        self.trajectory = PoseJournal()
        self.pose_map_base, self.pose_covariance = SE2(), np.zeros((3, 3))
        self.pose_odom_base, self.odom_covariance = SE2(), np.zeros((3, 3))
        self.travelled_m = 0.0
        self.scale = 1.0  # see `MapUpdate`
        self._lens_m = 0.0  # height of the lens
        self._relocated: SE2 | None = None  # see `MapUpdate`, for the next step
        self._searched_s = -math.inf  # stamp of the last picture that was searched
        self._blind: Motion | None = None  # since the last step
        self._watch = Stopwatch()

    def start_in(self, saved: SavedMap, start: SE2, sigmas: Sequence[float] = START_SIGMAS) -> None:
        """Continues a saved map from a stated pose. sigmas: of the start pose, m, m, rad. Raises MapError for a pose
        far from the map."""
        far = far_from_map([(start.x_m, start.y_m)], places_of(saved.objects, saved.grid))
        if far or math.isnan(start.yaw_rad):
            raise MapError(f"start pose: {far or 'its yaw is no number'}")
        self._continued, self.edits = saved, MapEvents.after(saved.annotations.zones)
        taken = [item.id for item in saved.annotations.vanished]
        self.map = FloorMap(self.config.association, self.config.loop_closure, taken)
        self.pose_map_base = SE2()
        self._join(saved, Alignment(start, np.diag(np.square(sigmas))))

    def continue_map(self, saved: SavedMap) -> None:
        """Continues a saved map from an unknown pose: relocalises by its objects, from its last pose and its dock (the
        origin without one) first. Where it has no object, the robot is taken to stand at the first of these, or at the
        origin or in the middle of its grid where that is far away."""
        dock, last = saved.annotations.dock or SE2(), saved.annotations.last_pose
        if saved.objects:
            self.relocalise_in(saved, [dock] if last is None else [last, dock])
        else:
            places = places_of((), saved.grid)
            starts = [last or dock, SE2(), SE2(*np.append(places.mean(axis=0), 0.0).tolist())]
            self.start_in(saved, next(one for one in starts if not far_from_map([(one.x_m, one.y_m)], places)))

    def relocalise_in(self, saved: SavedMap, guesses: Sequence[SE2] = ()) -> None:
        """Builds a separate map until its objects determine the robot's pose in the saved map, then continues that one.
        guesses: poses in the saved map at which the run may start; fewer objects confirm one of these. New objects are
        numbered after the saved ones, so ids stay unique; `merged` maps new objects to matching saved ones.
        """
        self.relocalise_by(Relocaliser([saved], self.config, guesses, saved))

    def relocalise_by(self, relocaliser: Relocaliser) -> None:
        """As `relocalise_in`, in one of the relocaliser's maps."""
        self.relocaliser, self.map = relocaliser, relocaliser.run_map
        self.edits = MapEvents.after(zone for place in relocaliser.places for zone in place.annotations.zones)

    def step(self, observed: FrameObservations) -> MapUpdate:
        """Processes one frame's observations: advance, close loops, associate, forget, relocalise."""
        self._watch.start()
        self.memory.begin(observed.stamp_s, self._shown_grid)
        stage = self._watch.stage
        with stage("closure"):
            observed = self._prepared(observed)
            self.scale = observed.scale if self.saved is None else 1.0
            self._advance(observed.motion)
            self._retilt(observed.mount_estimate)
            correction = self._close_loops(observed)
        with stage("map"):
            sightings = self._placed(observed)
            object_ids = self.map.update(sightings)
            self._forget(observed, object_ids)
        with stage("grid"):
            self._fuse_floor(observed)
        with stage("relocalisation"):
            became = self._relocalise()
            if became is not None:
                sightings = self._placed(observed)
                object_ids = [became.get(identity, identity) for identity in object_ids]
            relocated, self._relocated = self._relocated, None
            self.trajectory.append(observed.stamp_s, self.pose_map_base)
        object_ids, merged = self._shown_ids(sightings, object_ids)
        self.memory.sighted(object_ids)
        return MapUpdate(
            sightings=sightings,
            object_ids=object_ids,
            merged=merged,
            pose_map_base=self.pose_map_base,
            pose_covariance=self.pose_covariance,
            trajectory=self.trajectory,
            travelled_m=self.travelled_m,
            stages_ms=self._watch.stages_ms,
            pose_odom_base=self.pose_odom_base,
            odom_covariance=self.odom_covariance,
            correction=correction,
            relocated=relocated,
            annotations=self.annotations(),
            grid=self._shown_grid,
            floor_scan=self.grid.scan,
            scale=self.scale,
            at=self.memory.clock.utc(observed.stamp_s),
        )

    def _shown_ids(self, sightings: list[PlacedSighting], object_ids: list[str]) -> tuple[list[str], dict[str, str]]:
        """Ids of the sightings' objects as the map shows them, and all retired ids with those that replaced them."""
        if self.paper is not None:
            return self.paper.update(sightings), self.paper.merged
        if merges := self.edits.merges(self.map):
            object_ids = [merges.get(self.map.shown_as(identity), identity) for identity in object_ids]
        return object_ids, self.map.merged | merges

    def step_blind(self, motion: Motion) -> None:
        """A motion without observations; the next step takes it in."""
        motion = motion.checked("this")
        self._blind = motion if self._blind is None else _composed(self._blind, motion)

    def edit(self, edit: Edit) -> str:
        """Applies a person's edit of the map between two steps. Returns the id of its object or zone. Raises EditError.

        Edits are inputs as frames are: the same ones after the same frames make the same map. Pose, trajectory and
        measured objects do not depend on them, but on `pose`; a confirmed object is not forgotten.
        """
        if self.paper is not None and edit.do not in ("zone", "room", "dock", "undo"):
            raise EditError(f"{edit.do}: the paper's clustering keeps every sighting as it is")
        points = [point for point in (edit.place_m, edit.pose and edit.pose[:2], *edit.corners_m) if point is not None]
        if far := far_from_map(points, self._places()):
            raise EditError(f"{edit.do}: {far}")
        if edit.do == "pose":
            return self._set_pose(edit)
        identity = self.edits.take(edit, self.map, self.trajectory.stamps_near)
        self.memory.edited(edit, identity)
        return identity

    def objects(self) -> list[MapObject]:
        """The current map with edits, wall times and history, without furniture that the path of the base crosses. A
        saved map's objects stay, as the path may be wrong for a while: they leave by forgetting only."""
        if self.paper is not None:
            return self.memory.annotated(self.paper.objects(), self.paper.merged)
        shown, saved_ids = self.edits.shown(self.map), self.saved.ids if self.saved else ()
        path, new = self.map.graph.trajectory, [item for item in shown if item.id not in saved_ids]
        crossed = {item.id for item in new if is_crossed(item, path, self._lens_m)}
        shown = [item for item in shown if item.id not in crossed] if crossed else shown
        deleted = self.edits.annotations(self.map).deleted
        return self.memory.annotated(shown, self.map.merged | self.edits.merges(self.map), deleted)

    @property
    def saved(self) -> SavedMap | None:
        """The saved map that this run continues, entered yet or not; None without one, or where it is unknown."""
        return self._continued if self.relocaliser is None else self.relocaliser.saved

    @property
    def searching(self) -> bool:
        """Whether the robot has yet to be relocalised in a saved map."""
        return self.relocaliser is not None and self.relocaliser.alignment is None

    def annotations(self) -> Annotations:
        """Zones, deleted and vanished objects as they stand, and which map it is."""
        return self.memory.annotations(self.edits.annotations(self.map))

    def _fuse_floor(self, observed: FrameObservations) -> None:
        """Fuses the picture's floor into the grid. The grid that steps show is renewed once a second of stream."""
        if observed.camera is None:
            return
        self._lens_m = observed.camera.mount.height_m
        movers, detected, seen = mover_boxes(observed.detections), observed.detections.boxes, observed.pictured
        pose, camera = self._pose_of(observed), seen.camera or observed.camera
        self.grid.observe(pose, seen.stamp_s, camera, seen.floor, movers, detected, seen.depth)
        if self._shown_timer.due(observed.stamp_s):
            self._shown_grid = self.map.grid = self.grid.grid()

    def _set_pose(self, edit: Edit) -> str:
        """Set the robot's pose in the map, which stays as it is, and end a relocalisation. Raises EditError."""
        if edit.id == "dock":
            annotations = self.saved.annotations if self.searching and self.saved else self.annotations()
            if (dock := annotations.dock) is None:
                raise EditError("the map has no dock")
            edit = replace(edit, pose=(dock.x_m, dock.y_m, dock.yaw_rad))
        if edit.pose is None:
            raise EditError("a pose is x, y and yaw")
        pose, covariance = SE2(*edit.pose), np.diag(np.square(edit.sigmas or START_SIGMAS))
        if self.relocaliser is not None and self.searching:
            back = self.pose_map_base.inverse()
            covariance_a_b = compose_covariance(pose, covariance, back, np.zeros((3, 3)))
            self.relocaliser.alignment = Alignment(pose @ back, covariance_a_b)
            self._relocated = self.relocaliser.alignment.pose_a_b
            self._join(self.saved or SavedMap(), self.relocaliser.alignment)
        else:
            self.map = self.map.continued(self.map.objects())
            self.grid.transform(SE2())  # what it is fusing belongs to the pose before
        self.pose_map_base, self.pose_covariance = pose, covariance
        return "pose"

    def _places(self) -> Array:
        """Where the map is (N, 2): its objects, the robot, its grid, and the saved map that is searched."""
        robot = [(self.pose_map_base.x_m, self.pose_map_base.y_m)]
        saved = self.saved.measured if self.searching and self.saved else ()
        return np.array([*robot, *places_of([*self.objects(), *saved], self._shown_grid)])

    def _prepared(self, observed: FrameObservations) -> FrameObservations:
        """Drops observations with NaN, infinity or an invalid covariance, and adds the motion without pictures since
        the last step. Weighs each sighting by the time since the last searched picture, so that evidence does not
        depend on the rate."""
        sightings, motion = list(filter(_is_sound, observed.sightings)), observed.motion.checked("this")
        if self._blind is not None:
            motion, self._blind = _composed(self._blind, motion), None
        if observed.searched:
            stamp_s = observed.pictured.stamp_s
            since_s = stamp_s - self._searched_s if math.isfinite(self._searched_s) else PICTURE_S
            self._searched_s = stamp_s
            pictures = max(round(min(since_s / PICTURE_S, REPEATED), 2), 0.01)  # above 0: evidence is divided by it
            sightings = [replace(seen, pictures=pictures) for seen in sightings]
        return replace(observed, sightings=sightings, motion=motion)

    def _advance(self, motion: Motion) -> None:
        """Advance the pose by the motion; the first frame's pose is the map's origin and exact."""
        if len(self.trajectory):
            self.pose_covariance = compose_covariance(
                self.pose_map_base, self.pose_covariance, motion.motion, motion.covariance
            )
            self.pose_map_base = self.pose_map_base @ motion.motion
            self.odom_covariance = compose_covariance(
                self.pose_odom_base, self.odom_covariance, motion.motion, motion.covariance
            )
            self.pose_odom_base = self.pose_odom_base @ motion.motion
            self.travelled_m += math.hypot(motion.motion.x_m, motion.motion.y_m)

    def _retilt(self, seen: MountEstimate | None) -> None:
        """Move what was placed by the mount's angles when their estimate changes."""
        if seen is None:
            return
        tilt_rad = np.array([seen.used.roll_rad - seen.given.roll_rad, seen.used.pitch_rad - seen.given.pitch_rad])
        if (tilt_rad != self.map.graph.tilt_rad).any():
            self.map.graph.tilt_rad = tilt_rad
            self.map.moved()

    def _close_loops(self, observed: FrameObservations) -> LoopCorrection | None:
        """One unit of loop closure; a correction moves pose, trajectory, map, grid and edits."""
        graph, motion = self.map.graph, observed.motion
        if not len(graph.trajectory):
            graph.trajectory.begin(self.pose_map_base, self.pose_covariance, observed.stamp_s)
            return None
        is_keyframe = graph.trajectory.advance(motion.motion, motion.covariance, observed.stamp_s, motion.heading_rad2)
        ended, past = self.map.maintain(is_keyframe, self.closes_loops)
        if ended:
            self.pose_covariance = graph.trajectory.covariance
        corrections = [] if past is None else [past]
        if motion.instead is not None and self.paper is None:
            corrections.append(graph.trajectory.replace_motions(motion.instead, motion.in_map))
        if not corrections:
            return None
        before, self.pose_map_base = self.pose_map_base, graph.trajectory.pose
        for past in corrections:
            self.trajectory.correct(past)
            self.grid.moved(past)
            self.edits.moved(past)
        self.map.moved()
        self.memory.corrected()
        moved_m = math.hypot(self.pose_map_base.x_m - before.x_m, self.pose_map_base.y_m - before.y_m)
        return LoopCorrection(moved_m, graph.accepted)

    def _pose_of(self, observed: FrameObservations) -> SE2:
        """The pose, as estimated now, of the picture that detections and sightings are of."""
        if observed.before is None:
            return self.pose_map_base
        return SE2(*self.trajectory.at([observed.before.stamp_s])[0].tolist())

    def _placed(self, observed: FrameObservations) -> list[PlacedSighting]:
        """This step's sightings in the map."""
        pose, mount = self._pose_of(observed), observed.pictured.placed_by
        return [PlacedSighting(one, pose, self.pose_covariance, mount) for one in observed.sightings]

    def _forget(self, observed: FrameObservations, object_ids: Sequence[str]) -> None:
        """Lowers the presence of objects that should be visible but were not detected. object_ids: those detected."""
        if observed.searched and self.forgetter is not None:
            kept, pose, seen = self.edits.kept(self.map), self._pose_of(observed), observed.pictured
            self.forgetter.observe(self.map, observed.detections, pose, object_ids, seen.camera, kept, seen.floor)
            self.memory.missed(self.forgetter.missing)

    def _relocalise(self) -> dict[str, str] | None:
        """Joins the saved map in the step that relocalises the robot; the new ids of this run's objects, else None."""
        alignment = self.relocaliser and self.relocaliser.align()
        if alignment is None or self.saved is None:
            return None
        self._relocated = alignment.pose_a_b
        return self._join(self.saved, alignment)

    def _join(self, saved: SavedMap, alignment: Alignment) -> dict[str, str]:
        """Merges the saved map and this run's, in the saved one's frame. Returns the new ids of this run's objects."""
        rule = self.config.loop_closure.landmarks
        merged, became = merge_maps(saved.measured, self.map.objects(), alignment, rule)
        self.map = self.map.continued(merged, became)
        self.pose_covariance = compose_covariance(
            alignment.pose_a_b, alignment.covariance, self.pose_map_base, self.pose_covariance
        )
        self.pose_map_base = alignment.pose_a_b @ self.pose_map_base
        self.trajectory.transform(alignment.pose_a_b)
        self.grid.transform(alignment.pose_a_b)
        if saved.grid is not None:
            self.grid.continue_from(saved.grid)
        self.memory.enter(saved, became)
        self.edits.enter(saved.objects, saved.annotations, alignment.pose_a_b)
        return became


def places_of(objects: Iterable[MapObject], grid: OccupancyGrid | None) -> Array:
    """Where a map is, (N, 2) in metres: its objects and the corners of its grid; the origin for an empty one."""
    places = [item.position_m for item in objects]
    if grid is not None:
        first = np.array([grid.x_m, grid.y_m])
        places += [first, first + grid.cell_m * np.array(grid.log_odds.shape[::-1])]
    return np.array(places or [np.zeros(2)])


def far_from_map(points_m: Sequence[Sequence[float]], places_m: Array) -> str:
    """Why points (N, 2) that somebody states cannot belong to a map that has places (M, 2): it would be too wide. Empty
    where they can. A mistyped number would make a map that no reader takes, on a grid that fills the memory."""
    low, high = places_m.min(axis=0), places_m.max(axis=0)
    for x_m, y_m in points_m:
        wide_m = np.maximum(high, (x_m, y_m)) - np.minimum(low, (x_m, y_m))
        if not (wide_m <= np.maximum(high - low, WIDEST_M)).all():
            return f"x {x_m:g} m, y {y_m:g} m is too far: the map would be more than {WIDEST_M:g} m wide"
    return ""


def _composed(first: Motion, second: Motion) -> Motion:
    """Two motions, one after the other, as one: what the map depends on."""
    covariance = compose_covariance(first.motion, first.covariance, second.motion, second.covariance)
    path = second if second.instead else first
    return Motion(first.motion @ second.motion, covariance, instead=path.instead, in_map=path.in_map)


def _is_sound(sighting: Sighting) -> bool:
    covariance_m2, shared_m2, place_m = sighting.covariance_m2, sighting.shared_m2, sighting.position_base_m.tolist()
    sizes = sighting.score, sighting.width_m, sighting.height_m, sighting.stamp_s
    if not all(map(math.isfinite, (*sizes, *place_m, *covariance_m2.ravel().tolist(), *shared_m2.ravel().tolist()))):
        return False
    ((xx, xy), (_, yy)), ((shared_xx, _), (_, shared_yy)) = covariance_m2.tolist(), shared_m2.tolist()
    return (
        is_covariance(covariance_m2)
        and is_covariance(shared_m2)
        and xx * yy - xy * xy > 1e-10 * (xx + yy)  # so the smaller eigenvalue is above 1e-10 m2, and its inverse finite
        and xx + yy + shared_xx + shared_yy < FARTHEST_M**2
        and math.hypot(*place_m) < FARTHEST_M
    )
