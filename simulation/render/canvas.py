"""OpenGL without a screen: one GLSL program for each kind of surface, meshes and textures in memory, draw batches.

The GLSL source in glsl/ serves all kinds of surface; `program` leaves out what a kind does not need. Mesa draws on the
processor, where each fragment is expensive. Matte, plain surfaces therefore get their colour at the vertices. Only
glossy surfaces compute highlights, and only surfaces with holes may discard fragments. Colours are stored as square
roots (textures in, pixels out) because gamma curves cost more than everything else. `DISPLAY` converts square roots to
sRGB afterwards."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from edgemap.simulation.errors import SimulationError
from edgemap.simulation.render.batches import Batch, Packed
from edgemap.simulation.render.mesh import Array

LAMPS = 4
THREE_OF_FOUR = {"normal": "3i1 1x", "tint": "3f1 1x"}  # moderngl's formats of bytes; a tint's are 0..1
# From the square root of display-linear light to sRGB gamma, both 0..255.
DISPLAY = np.round(255.0 * (np.arange(256) / 255.0) ** (2.0 / 2.2)).astype(np.uint8)


def shader(name: str, needs: Iterable[str] = ()) -> list[str]:
    """Vertex and fragment shader glsl/NAME. needs: names that are defined in both."""
    head = "#version 330\n" + "".join(f"#define {need}\n" for need in needs)
    return [head + Path(__file__).with_name("glsl").joinpath(f"{name}.{kind}").read_text() for kind in ("vert", "frag")]


class RenderTarget:
    """One OpenGL context with its programs and textures. Raises SimulationError if OpenGL is missing."""

    def __init__(self) -> None:
        import moderngl

        self.gl: Any = moderngl
        libraries = {"libgl": "libGL.so.1", "libegl": "libEGL.so.1"}
        try:
            self.context = self.gl.create_context(standalone=True, backend="egl", **libraries)
        except Exception as error:
            raise SimulationError(
                f"no OpenGL without a screen ({error}): apt-get install libegl1 libegl-mesa0 libgl1 libgl1-mesa-dri"
            ) from None
        self._programs: dict[frozenset[str], Any] = {}
        self._textures: dict[int, tuple[NDArray[np.uint8], Any]] = {}
        self.silhouette = self.context.program(*shader("silhouette"))
        self._shadow = self.context.program(*shader("shadow"))
        square = np.array([[-1, -1], [1, -1], [-1, 1], [1, 1]], dtype="f4")
        self._square = self.context.vertex_array(
            self._shadow, [(self.context.buffer(square.tobytes()), "2f", "corner")]
        )

    def program(self, needs: frozenset[str]) -> Any:
        """The program that draws surfaces with these needs. It is compiled at the first call."""
        if needs not in self._programs:
            made = self._programs[needs] = self.context.program(*shader("surface", needs))
            for unit, name in enumerate(("image", "light_map")):
                if name in made:
                    made[name] = unit
        return self._programs[needs]

    def texture(self, image: NDArray[np.uint8]) -> Any:
        """The OpenGL texture of an image (H, W, 4), sRGB. It is uploaded once."""
        if id(image) not in self._textures:
            # The image is kept too, so that its id is not reused.
            self._textures[id(image)] = image, self._uploaded(image)
        return self._textures[id(image)][1]

    def shadow(self, clip: NDArray[np.float64], place: tuple[float, ...]) -> None:
        """Darkens the floor under an object. place: centre and half sides (x, y, a, b), metres, in the frame that
        `clip` transforms.
        """
        self._shadow["clip_home"].write(clip.T.astype("f4").tobytes())
        self._shadow["place"] = place
        self._square.render(self.gl.TRIANGLE_STRIP)

    def target(self, size: tuple[int, int], components: int = 4, depth: bool = True) -> Any:
        """A framebuffer (width, height) with 8-bit components and an optional depth buffer."""
        colour = self.context.renderbuffer(size, components)
        return self.context.framebuffer(colour, self.context.depth_renderbuffer(size) if depth else None)

    def _uploaded(self, image: NDArray[np.uint8]) -> Any:
        """A texture with mipmaps. Its sides are powers of two, because Mesa compiles each shader again for each kind of
        texture. Colours are stored as square roots of linear light.
        """
        size = tuple(1 << max(4, round(math.log2(side))) for side in image.shape[1::-1])
        if size != image.shape[1::-1]:
            image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)  # type: ignore[assignment]
        root = np.round(255.0 * (np.arange(256) / 255.0) ** 1.1).astype(np.uint8)
        pixels = np.concatenate([root[image[..., :3]], image[..., 3:]], axis=2)
        texture = self.context.texture(size, 4, np.ascontiguousarray(pixels[::-1]).tobytes())
        texture.build_mipmaps()
        texture.filter = (self.gl.LINEAR_MIPMAP_LINEAR, self.gl.LINEAR)
        return texture


class Meshes:
    """Vertices and triangles in OpenGL memory, which any program can draw."""

    def __init__(self, canvas: RenderTarget, packed: Packed) -> None:
        self.packed = packed
        self._canvas = canvas
        self._arrays: dict[int, Any] = {}
        self.vertices = canvas.context.buffer(packed.vertices.tobytes())
        self._indices = canvas.context.buffer(packed.indices.tobytes())

    def array(self, program: Any) -> Any:
        """The vertex array that feeds a program. Attributes that it does not read are padding in moderngl's format."""
        if program.glo not in self._arrays:
            dtype = self.packed.vertices.dtype
            parts = {name: dtype[name] for name in dtype.names or ()}
            kinds = {name: f"{part.shape[0]}f{part.base.itemsize}" for name, part in parts.items()} | THREE_OF_FOUR
            read = " ".join(kinds[name] if name in program else f"{part.itemsize}x" for name, part in parts.items())
            content = (self.vertices, read, *(name for name in parts if name in program))
            self._arrays[program.glo] = self._canvas.context.vertex_array(
                program, [content], self._indices, index_element_size=4
            )
        return self._arrays[program.glo]


@dataclass(frozen=True, slots=True)
class Draw:
    """One batch to draw. meshes: contain its vertices. slot: its object's number among those of the picture, below 255;
    0 is the room.

    clip: (4, 4), transform from the frame of the batch to clip coordinates. eye: (3,), position of the camera in the
    frame of the batch, metres. home: (4, 4), transform from the frame of the batch to the home, for moving objects.
    """

    meshes: Meshes
    batch: Batch
    slot: int
    clip: Array
    eye: Array
    home: Array | None = None
