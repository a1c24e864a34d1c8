"""How long it takes to edit a cluster of a hair tree.

Run `python benchmarks/editing.py`. First 1 340 clusters are bound to one and follow it
(figure 4-20 of the thesis has as many); then one cluster of 100 is edited, of which
10 000 strands of 40 segments grow.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from strands import POINTS, ROOTS, STRANDS, machine, make_tree, measure

from hairfit import model
from hairfit.model.bind import bind_points, follow, update_points
from hairfit.model.edit import edit_cluster
from hairfit.model.style import resample_knots

CLUSTERS = 100


def edited(cylinder: model.GeneralizedCylinder) -> model.GeneralizedCylinder:
    """Return one cluster bent, twisted and scaled."""
    share = jnp.linspace(0.0, 1.0, len(cylinder.twist), dtype=jnp.float32)
    bend = 0.03 * share[:, None] ** 2 * jnp.array([[1.0, 0.5, -0.3]], jnp.float32)
    return eqx.tree_at(
        lambda c: (c.skeleton, c.twist, c.scale),
        cylinder,
        (cylinder.skeleton + bend, cylinder.twist + share, 1.2 * cylinder.scale),
    )


def bind_and_update(knots: int) -> None:
    """Print how long it takes 1 340 clusters to follow one."""
    tree = resample_knots(make_tree(), knots)
    before = model.cluster(tree.cylinder, 0)
    after = edited(before)
    points = tree.cylinder.skeleton.reshape(-1, 3)
    name = f"{tree.count} clusters of {knots} knots"
    measure(
        f"bind and update the control points of {name}",
        lambda: update_points(after, bind_points(before, points)),
    )
    measure(f"follow: {name}", lambda: follow(before, after, tree.cylinder))
    measure(
        "the same, whole skeletons fitted",
        lambda: follow(before, after, tree.cylinder, whole_skeleton=True),
    )


def edit_and_regrow() -> None:
    """Print how long it takes to edit one cluster of many, and to grow its strands."""
    big = make_tree()
    some = np.arange(40, 40 + CLUSTERS)  # of the second level
    contour, cylinder, variation = jax.tree.map(
        lambda leaf: leaf[some], (big.contour, big.cylinder, big.length_variation)
    )
    parent = (-1,) * CLUSTERS
    tree = model.HairTree(big.scalp, contour, cylinder, variation, parent)
    uv = model.sample_roots(tree.scalp, ROOTS, jax.random.key(0))
    owner = model.find_owner(tree, uv)
    owned = jnp.flatnonzero(owner >= 0)[:STRANDS]
    uv, owner = uv[owned], owner[owned]
    eta = jnp.ones(len(owned), jnp.float32)
    strands = model.grow_strands(tree, uv, owner, eta, POINTS)
    # A cluster with as many strands as the mean.
    count = np.bincount(np.asarray(owner), minlength=CLUSTERS)
    index = int(np.argmin(np.abs(count - count.mean())))
    new = edited(model.cluster(tree.cylinder, index))

    def all_strands():
        after = edit_cluster(tree, index, new)
        return model.grow_strands(after, uv, owner, eta, POINTS)

    def its_strands():
        after = edit_cluster(tree, index, new)
        return model.regrow_strands(after, strands, uv, owner, eta, [index])

    name = f"of {len(owned)} x {POINTS - 1} segments"
    measure(f"edit one cluster of {CLUSTERS}, grow all strands {name}", all_strands)
    measure(f"the same, grow its {count[index]} strands only", its_strands)
    after = edit_cluster(tree, index, new)
    measure(
        "  growing all strands alone",
        lambda: model.grow_strands(after, uv, owner, eta, POINTS),
    )
    measure(
        "  growing its strands alone",
        lambda: model.regrow_strands(after, strands, uv, owner, eta, [index]),
    )


def main() -> None:
    """Print all figures."""
    print(machine())
    for knots in (10, 16):
        bind_and_update(knots)
    edit_and_regrow()


if __name__ == "__main__":
    main()
