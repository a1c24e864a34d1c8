"""OpenGL without a window, its compute kernels and buffers."""

from collections.abc import Mapping
from importlib import resources
from typing import Any

import numpy as np

from ...errors import InputError

# Invocations of a work group.
GROUP = 128
# Compute shaders and storage buffers came with OpenGL 4.3.
COMPUTE = 430
# What the thesis's own passes need.
OLDEST = 330


class NoContextError(InputError):
    """There is no OpenGL here; callers draw their picture without."""


def open_context() -> Any:
    """Return an OpenGL context without a window, or say how to get one.

    NVIDIA's driver makes one of the version that is asked for, and no newer one. A
    driver without compute shaders gives one for the thesis's passes.
    """
    import sys

    import moderngl

    options: Any = {"backend": "egl"} if sys.platform.startswith("linux") else {}
    try:
        try:
            return moderngl.create_standalone_context(require=COMPUTE, **options)
        except Exception:  # the type is each driver's own
            return moderngl.create_standalone_context(require=OLDEST, **options)
    except Exception as error:
        raise NoContextError(
            f"no OpenGL context without a window could be made ({error}); "
            "install Mesa's EGL (on Debian or Ubuntu: `apt-get install libegl1 "
            "libgl1-mesa-dri`)."
        ) from error


def source(name: str, **constants: int | str) -> str:
    """Return the text of a shader of this package, with what it includes.

    Args:
        name: The file.
        constants: Names that the text uses, and their values; the compiler then drops
            what they rule out.
    """
    text = (resources.files("hairfit.render.gl") / "glsl" / name).read_text()
    lines = []
    for line in text.splitlines():
        words = line.split()
        included = len(words) == 2 and words[0] == "#include"
        within = source(words[1].strip('"'), **constants) if included else line
        lines.append(within)
        if words[:1] == ["#version"]:
            lines += [f"#define {key} {value}" for key, value in constants.items()]
    return "\n".join(lines)


def set_uniforms(program: Any, values: Mapping[str, Any]) -> None:
    """Write uniforms by name; those that the program does not use are left out.

    Matrices are given as NumPy has them, rows first.
    """
    for name, value in values.items():
        if name not in program:
            continue
        if isinstance(value, np.ndarray) and value.ndim == 2:
            value = value.T
        if isinstance(value, np.ndarray):
            program[name].write(np.ascontiguousarray(value, np.float32).tobytes())
        else:
            program[name].value = value


class Kernel:
    """A compute shader, run over many items at once."""

    def __init__(self, context: Any, name: str, **constants: int | str):
        self.context = context
        text = source(name, GROUP=GROUP, **constants)
        self.program = context.compute_shader(text)

    def run(self, count: int, buffers: Mapping[int, Any], **uniforms: Any) -> None:
        """Run it for the items 0 to `count - 1`.

        Args:
            count: How many; the shader's uniform `count`.
            buffers: Storage buffers by their binding.
            uniforms: Values by name.
        """
        if count == 0:
            return
        for binding, buffer in buffers.items():
            buffer.bind_to_storage_buffer(binding)
        set_uniforms(self.program, {"count": count, **uniforms})
        self.program.run((count + GROUP - 1) // GROUP)
        self.context.memory_barrier()


def read(buffer: Any, dtype: type, shape: tuple[int, ...]) -> np.ndarray:
    """Return the start of a buffer as an array."""
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    return np.frombuffer(buffer.read(size=size), dtype).reshape(shape).copy()
