"""Refines one tree on as many devices as there are; run by `test_devices.py`.

In double precision: where strands lie along the photographs, single precision leaves
noise alone of the gradient, and Adam makes steps of it.
"""

import sys

import jax
import jax.numpy as jnp
import numpy as np
from ball_hair import RADIUS, ball, dome, hull_where, photograph, ring

from hairfit.fit.devices import device_mesh
from hairfit.fit.evidence import Field
from hairfit.fit.refine import Photographs, RefineConfig, Samples, refine
from hairfit.fit.residuals import image_loss, photo_maps, seen_segments
from hairfit.fit.volume import hair_volume
from hairfit.model import (
    HairTree,
    ScalpContour,
    find_owner,
    grow_strands,
    plant,
    sample_roots,
)

STRANDS, KNOTS = 400, 8


def main(out: str) -> None:
    """Write what came out, the loss of the photographs and its gradient."""
    contour = jax.vmap(ScalpContour)(
        jnp.array([[0.35, 0.4], [0.65, 0.6], [0.6, 0.6]]),
        jnp.array([0.3, 0.3, 0.2]),
        jnp.zeros((3, 32)),
    )
    planted = jax.vmap(lambda c: plant(dome(), c, 0.1, KNOTS))(contour)
    tree = HairTree(dome(), contour, planted, jnp.zeros(3), (-1, -1, 1))
    uv = sample_roots(tree.scalp, 3 * STRANDS, jax.random.key(2))
    owner = np.asarray(find_owner(tree, uv))
    held = np.resize(np.flatnonzero(owner >= 0), STRANDS)
    uv = jnp.asarray(uv)[held]
    samples = Samples(uv, jnp.asarray(owner[held], jnp.int32))
    grown = grow_strands(tree, *samples, jnp.ones(STRANDS), 12)
    true = np.asarray(grown, float) + [0.004, 0.0, -0.003]
    taken = photograph(true, ring(4), ball(), radius_px=1.5)
    seen = Photographs(
        taken.views, taken.depths, photo_maps(taken.views, taken.maps, taken.depths)
    )
    hull = hull_where(
        lambda p: np.linalg.norm(p, axis=1) > RADIUS, [-0.2] * 3, [0.2] * 3, 0.02
    )
    nothing = np.zeros(hull.grid.shape)
    field = Field(np.zeros((*nothing.shape, 3)), nothing)
    mesh = device_mesh(4, STRANDS)
    shown = jnp.asarray(seen_segments(np.asarray(grown), taken.views, taken.depths))
    maps, volume = jax.tree.map(
        lambda x: x.astype(float), (seen.maps, hair_volume(hull, field))
    )
    seen = seen._replace(maps=maps)
    loss = jax.jit(jax.value_and_grad(lambda s: image_loss(s, shown, maps, mesh)))
    value, gradient = loss(grown)
    config = RefineConfig(rounds=1, steps=5, points=12)
    found = refine(tree, samples, seen, volume, true.reshape(-1, 3), config)
    after = grow_strands(found, *samples, jnp.ones(STRANDS), 12)
    np.savez(
        out,
        devices=len(jax.devices()),
        rows=[] if mesh is None else mesh.devices.shape,
        value=value,
        gradient=gradient,
        before=grown,
        after=after,
    )


if __name__ == "__main__":
    main(sys.argv[1])
