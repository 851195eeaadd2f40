"""The pictures of a world in order, made by one process or two."""

from collections.abc import Iterable, Iterator

from edgemap.simulation.pool import default_workers, ordered
from edgemap.simulation.studio import Shot, Studio, lit_home
from edgemap.simulation.world import World

# Below this many pictures starting processes takes longer than it saves.
_FEW = 40
_studio: Studio | None = None


def shots(world: World, indices: Iterable[int], workers: int | None = None) -> Iterator[Shot]:
    """Pictures of the given indices, in that order; the same whatever the number of processes."""
    todo = list(indices)
    workers = workers or (1 if len(todo) < _FEW else default_workers())
    if not todo:
        return
    lit = lit_home(world)
    if workers > 1:
        yield from ordered(_shoot, todo, workers, _open, world, lit)
        return
    studio = Studio(world, lit)
    try:
        for index in todo:
            yield studio.shoot(index)
    finally:
        studio.close()


def _open(*given: object) -> None:
    global _studio
    _studio = Studio(*given)  # type: ignore[arg-type]


def _shoot(index: int) -> Shot:
    assert _studio is not None
    return _studio.shoot(index)
