"""How long it takes to observe hair, and to get the gradient of what is seen.

Run `python benchmarks/observe.py`. A head of 2 000 strands of 32 segments fills a
picture of 256 x 256 pixels; a segment is 4 pixels long. Compiling is not counted.
Beside the times stands the temporary memory of the compiled program.
"""

import statistics
import time
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from strands import machine

from hairfit.render import Camera, Fibre
from hairfit.render.lights import DistantLight, ShadowConfig, shade
from hairfit.render.observe import Appearance, ObserveConfig, observe
from hairfit.render.opacity_volume import OpacityConfig, opacity_volume
from hairfit.render.strand_samples import samples_needed
from hairfit.render.view import View, camera_view

STRANDS, KNOTS, SIZE = 2_000, 33, 256
STEP = 0.0049  # Length of a segment, in metres.
WIDTH = 3e-4
REPEATS = 5


def make_bob(seed: int = 0) -> jax.Array:
    """Return strands that leave a ball of 9 cm, and fall with waves of their own."""
    rng = np.random.default_rng(seed)
    out = rng.normal(size=(STRANDS, 3))
    out[:, 1] = np.abs(out[:, 1])
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    way, steps = out - [0.0, 0.6, 0.0], []
    for _ in range(KNOTS - 1):
        way = way + [0.0, -0.1, 0.0] + 0.1 * rng.normal(size=way.shape)
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        steps.append(STEP * way)
    path = np.cumsum(np.stack(steps, axis=1), axis=1)
    points = 0.09 * out[:, None] + np.concatenate([0.0 * path[:, :1], path], axis=1)
    return jnp.asarray(points, jnp.float32)


def make_camera() -> Camera:
    """Return a camera 0.8 m before the hair, whose picture it fills."""
    K = jnp.array([[700.0, 0.0, 128.0], [0.0, 700.0, 118.0], [0.0, 0.0, 1.0]])
    pose = jnp.diag(jnp.array([1.0, -1.0, -1.0, 1.0])).at[2, 3].set(0.8)
    return Camera(K, pose, SIZE, SIZE)


def make_view() -> View:
    """Return that camera's view."""
    return camera_view(make_camera())


def measure(what: str, function: Callable, *arguments) -> None:
    """Print the median time of a function, and the memory that it needs meanwhile."""
    start = time.perf_counter()
    run = jax.jit(function).lower(*arguments).compile()
    compiling = time.perf_counter() - start
    times = []
    for _ in range(REPEATS + 1):
        start = time.perf_counter()
        jax.block_until_ready(run(*arguments))
        times.append(time.perf_counter() - start)
    analysis = run.memory_analysis()
    memory = f"{analysis.temp_size_in_bytes / 1e6:6.0f} MB" if analysis else "unknown"
    print(
        f"{what:<44} {1e3 * statistics.median(times[1:]):8.1f} ms"
        f"   (best {1e3 * min(times[1:]):.1f}, compiling {compiling:.1f} s) {memory}",
        flush=True,
    )


def measure_observe() -> None:
    """Print all figures."""
    points, view = make_bob(), make_view()
    samples = samples_needed(points, view)
    width = jnp.asarray(WIDTH, jnp.float32)
    look = Appearance(width, jnp.full_like(points, 0.5))
    print(f"{STRANDS * (KNOTS - 1)} segments, {samples} samples each, {SIZE} x {SIZE}")
    for form in ("scatter", "gather"):
        config = ObserveConfig(samples=samples, form=form)

        def seen(p, config=config):
            return observe(p, view, look, config=config)

        def loss(p, seen=seen):
            return sum(jnp.sum(x**2) for x in seen(p))

        measure(f"observe, {form}", seen, points)
        measure(f"observe with its gradient, {form}", jax.value_and_grad(loss), points)
    light = DistantLight(jnp.array([0.3, 1.0, 0.5]), jnp.ones(3))
    brown = jnp.array([0.4, 0.3, 0.2])
    fibre = Fibre(0.2 * brown, brown, jnp.full(3, 0.3), jnp.asarray(20.0))
    opacity = OpacityConfig(slabs=40, samples=samples)
    shadow_config = ShadowConfig(opacity=OpacityConfig(samples=samples))

    def shadows(p):
        sight, between = light.view(p, 200)
        volume = opacity_volume(p, width, sight, between=between, config=opacity)
        return jnp.sum(volume.transmittance(p.reshape(-1, 3)))

    def shaded(p):
        eye = jnp.array([0.0, 0.0, 0.8])
        radiance = shade(
            p, width, eye, fibre, [light], ambient=jnp.ones(3), config=shadow_config
        )
        lit = Appearance(width, radiance)
        config = ObserveConfig(samples=samples)
        return sum(jnp.sum(x**2) for x in observe(p, view, lit, config=config))

    measure("opacity volume, 40 slabs of 200 x 200", shadows, points)
    measure("the same with its gradient", jax.value_and_grad(shadows), points)
    measure("shade by one light and observe, gradient", jax.grad(shaded), points)


if __name__ == "__main__":
    print(machine())
    measure_observe()
