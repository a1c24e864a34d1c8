"""What goes to the graphics card and comes back: buffers, points, textures."""

from typing import Any

import numpy as np
from jaxtyping import Float


class Buffers(dict[str, Any]):
    """Buffers of one context."""

    def __init__(self, context: Any):
        super().__init__()
        self.context = context

    def write(self, name: str, value: np.ndarray) -> None:
        """Write an array to a buffer."""
        self.reserve(name, value.nbytes)
        if value.nbytes:
            self[name].write(np.ascontiguousarray(value))

    def reserve(self, name: str, size: int) -> None:
        """Make sure that a buffer has so many bytes; what it held may be lost."""
        size = max(size, 16)
        if name in self and self[name].size >= size:
            return
        if name in self:
            self[name].release()
        self[name] = self.context.buffer(reserve=size)

    def release(self) -> None:
        """Give the memory back."""
        for buffer in self.values():
            buffer.release()
        self.clear()


def point_rows(
    strands: Float[np.ndarray, "strands knots 3"], width: float
) -> Float[np.ndarray, "strands knots 4"]:
    """Return points with the width of the segment to the next, 0 at tips; float32."""
    rows = np.zeros((*strands.shape[:2], 4), np.float32)
    rows[..., :3] = strands
    rows[:, :-1, 3] = width
    return rows


def picture(texture: Any) -> Float[np.ndarray, "height width parts"]:
    """Return a texture of 32 bit floats as an array."""
    values = np.frombuffer(texture.read(), np.float32)
    return values.reshape(texture.height, texture.width, texture.components)
