"""Front end and back end for a camera: the one builder of `run`, `bench` and sessions."""

from collections.abc import Collection
from dataclasses import dataclass, replace

from edgemap.geometry.camera.floor import FloorCamera
from edgemap.runtime.inputs.cameras.protocol import Camera
from edgemap.runtime.motion.attitude.open import open_attitude
from edgemap.runtime.motion.odometry import open_odometry
from edgemap.runtime.network.bundle import Bundle
from edgemap.runtime.step.config import Config
from edgemap.runtime.step.mapper import new_mapper
from edgemap.runtime.step.pipeline import Pipeline
from edgemap.runtime.step.slam import SemanticSlam


@dataclass(frozen=True, slots=True)
class SlamOptions:
    """Options of a run, as opposed to tuned parameters. The defaults are those of `edgemap run`.

    odometry: a SPEC. wheels, imu: whether the source's own are used. clustering: default or paper. forgets: whether
    objects that have disappeared are removed from the map. mapped, confidence: the bundle's own where None.
    """

    odometry: str = "hybrid"
    wheels: bool = True
    imu: bool = True
    clustering: str = "default"
    loop_closure: bool = True
    forgets: bool = False
    allow_untrained: bool = False
    mapped: Collection[str] | None = None
    confidence: float | None = None


def build_slam(
    camera: Camera, bundle: Bundle, floor: FloorCamera, options: SlamOptions | None = None, config: Config | None = None
) -> SemanticSlam:
    """An empty map and all that fills it. floor: the camera's lens and mount. Raises OdometryError."""
    options, config = options or SlamOptions(), config or Config()
    odometry = open_odometry(
        options.odometry, bundle, camera, floor, options.allow_untrained, options.wheels, config.odometry
    )
    pipeline = Pipeline(
        bundle,
        floor,
        odometry,
        rule=replace(config.floor, mapped=options.mapped),
        attitude=open_attitude(options.odometry, camera, floor, options.imu, config.attitude),
        confidence=options.confidence,
        health=config.health,
        rest=config.rest,
        height=config.height,
    )
    forgets = floor if options.forgets else None
    mapper = new_mapper(config, options.clustering, options.odometry, options.loop_closure, forgets)
    return SemanticSlam(pipeline, mapper)
