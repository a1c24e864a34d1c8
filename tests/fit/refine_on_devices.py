"""Refines one tree on as many devices as there are; run by `test_devices.py`.

In double precision: where strands lie along the photographs, single precision leaves
noise alone of the gradient, and Adam makes steps of it.
"""

import sys

import jax
import jax.numpy as jnp
import numpy as np
from refine_case import refine_case

from hairfit.fit.devices import device_mesh
from hairfit.fit.refine import RefineConfig, refine
from hairfit.fit.residuals import image_loss, seen_segments

STRANDS, VIEWS = 400, 4


def main(out: str) -> None:
    """Write what came out, the loss of the photographs and its gradient."""
    case = refine_case(STRANDS, 8, VIEWS)
    grown = case.grown(case.tree)
    views, depths, maps = case.photographs
    maps, volume = jax.tree.map(lambda x: x.astype(float), (maps, case.volume))
    mesh = device_mesh(VIEWS, STRANDS)
    shown = jnp.asarray(seen_segments(np.asarray(grown), views, depths))
    loss = jax.jit(jax.value_and_grad(lambda s: image_loss(s, shown, maps, mesh)))
    value, gradient = loss(grown)
    found = refine(
        case.tree,
        case.samples,
        case.photographs._replace(maps=maps),
        volume,
        case.places,
        RefineConfig(rounds=1, steps=5, points=12),
    )
    np.savez(
        out,
        devices=len(jax.devices()),
        rows=[] if mesh is None else mesh.devices.shape,
        value=value,
        gradient=gradient,
        before=grown,
        after=case.grown(found),
    )


if __name__ == "__main__":
    main(sys.argv[1])
