"""How long it takes to grow strands from a hair tree, and to find their owners.

Run `python benchmarks/strands.py`. The tree has 40 root clusters, 300 below them and
1 000 leaves; 10 000 strands of 40 segments grow from it.
"""

import os
import pathlib
import platform
import statistics
import time

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from hairfit import model

LEVELS = (40, 300, 1000)
STRANDS, POINTS, KNOTS = 10_000, 41, 10
ROOTS = 100_000
REPEATS = 15


def machine() -> str:
    """Return what the figures were measured on, in one line."""
    cpu = platform.processor() or platform.machine()
    info = pathlib.Path("/proc/cpuinfo")
    if info.exists():
        names = [x for x in info.read_text().splitlines() if x.startswith("model name")]
        cpu = names[0].split(":")[1].strip() if names else cpu
    device = jax.devices()[0]
    return (
        f"{cpu}, {os.cpu_count()} cores; JAX on {device.device_kind}; "
        f"Python {platform.python_version()}, jax {jax.__version__}"
    )


def make_scalp() -> model.Scalp:
    """Return a dome like a scalp, 9 cm in radius."""
    side = np.linspace(-1.0, 1.0, 13)
    x, z = np.meshgrid(side, side, indexing="ij")
    up = np.stack([0.9 * x, 0.55 * np.ones_like(x), -0.9 * z], axis=-1)
    up /= np.linalg.norm(up, axis=-1, keepdims=True)
    return model.Scalp(jnp.asarray(0.09 * up, jnp.float32))


def make_tree(seed: int = 0) -> model.HairTree:
    """Return a tree whose clusters stand anywhere on the scalp and bend at random."""
    rng = np.random.default_rng(seed)
    scalp = make_scalp()
    centres = [rng.uniform(size=(count, 2)) for count in LEVELS]
    parent = [-1] * LEVELS[0]
    for i in range(len(LEVELS) - 1):
        apart = np.linalg.norm(centres[i + 1][:, None] - centres[i][None], axis=-1)
        parent += (np.argmin(apart, axis=1) + sum(LEVELS[:i])).tolist()
    centre = jnp.asarray(np.concatenate(centres), jnp.float32)
    radius = np.concatenate([np.full(n, 1.2 / np.sqrt(n)) for n in LEVELS])
    offset = 0.1 * radius[:, None] * rng.normal(size=(len(centre), 32))
    contour = jax.vmap(model.ScalpContour)(
        centre, jnp.asarray(radius, jnp.float32), jnp.asarray(offset, jnp.float32)
    )
    cylinder = jax.vmap(lambda c: model.plant(scalp, c, 0.25, KNOTS))(contour)
    bend = 0.01 * rng.normal(size=cylinder.skeleton.shape).cumsum(axis=1)
    skeleton = cylinder.skeleton + jnp.asarray(bend, jnp.float32)
    cylinder = eqx.tree_at(lambda c: c.skeleton, cylinder, skeleton)
    variation = jnp.full(len(centre), 0.2, jnp.float32)
    return model.HairTree(scalp, contour, cylinder, variation, tuple(parent))


def measure(what: str, run) -> None:
    """Print the median time of `run`, without its first call, which compiles."""
    times = []
    for _ in range(REPEATS + 1):
        start = time.perf_counter()
        jax.block_until_ready(run())
        times.append(time.perf_counter() - start)
    print(
        f"{what:<58} {1e3 * statistics.median(times[1:]):8.1f} ms"
        f"   (best {1e3 * min(times[1:]):.1f}, first call {1e3 * times[0]:.0f})"
    )


def main() -> None:
    """Print all figures."""
    print(machine())
    tree = make_tree()
    uv = model.sample_roots(tree.scalp, ROOTS, jax.random.key(0))
    clusters, leaves = tree.count, len(model.leaves(tree))
    measure(
        f"owners of {ROOTS} roots among {clusters} clusters",
        lambda: model.find_owner(tree, uv),
    )
    owner = model.find_owner(tree, uv)
    owned = jnp.flatnonzero(owner >= 0)[:STRANDS]
    uv, owner = uv[owned], owner[owned]
    eta = 1.0 - 0.2 * jax.random.uniform(jax.random.key(1), (len(owned),))
    name = f"{len(owned)} strands x {POINTS - 1} segments, {leaves} leaf clusters"
    measure(name, lambda: model.grow_strands(tree, uv, owner, eta, POINTS))

    def size(skeleton, tree):
        tree = eqx.tree_at(lambda t: t.cylinder.skeleton, tree, skeleton)
        return jnp.sum(model.grow_strands(tree, uv, owner, eta, POINTS) ** 2)

    slope = jax.jit(jax.grad(size))
    measure("the same with its gradient", lambda: slope(tree.cylinder.skeleton, tree))
    scalp_uv = jax.jit(jax.vmap(model.scalp_uv, (None, 0)))
    p = jax.vmap(model.scalp_point, (None, 0))(tree.scalp, uv)
    measure(f"(u, v) of {len(p)} points", lambda: scalp_uv(tree.scalp, p))


if __name__ == "__main__":
    main()
