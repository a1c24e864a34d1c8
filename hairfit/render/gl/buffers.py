"""Storage buffers by name, that grow as they must."""

from typing import Any

import numpy as np


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
