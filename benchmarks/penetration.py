"""How long it takes to move hair out of a head (thesis, section 4.6.4).

Run `python benchmarks/penetration.py`. 100 000 strands of 40 points fall over the head
of `hairfit synth`, once as they are and once pressed into it.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from strands import machine, make_tree, measure

from hairfit import model
from hairfit.capture.distance import head_field, signed_distance
from hairfit.model.collide import push_out_points, push_out_strands, push_out_tree
from hairfit.synthetic import make_head, make_scalp, make_style

STRANDS, POINTS = 100_000, 40
GAP = 0.0005


def hair(tree: model.HairTree) -> jax.Array:
    """Return 100 000 strands of a tree: fewer, repeated a millimetre apart."""
    some = model.sample_strands(tree, STRANDS // 10, POINTS, jax.random.key(0))
    shift = 0.001 * jax.random.normal(jax.random.key(1), (10, 1, 1, 3))
    return (some[None] + shift).reshape(-1, POINTS, 3)


def main() -> None:
    """Print all figures."""
    print(machine())
    head = make_head()
    field = head_field(head)
    print(f"distance field of {' x '.join(map(str, field.distance.shape))} points")
    measure("the same, from the mesh", lambda: head_field(head).distance)
    tree = make_style("straight", 3, make_scalp(head))
    for squeeze in (1.0, 0.8, 0.5):
        shape = jnp.array([squeeze, 1.0, squeeze])[None, None]
        pressed = tree.cylinder.skeleton.at[:, 1:].multiply(shape)
        strands = hair(eqx.tree_at(lambda t: t.cylinder.skeleton, tree, pressed))
        flat = strands.reshape(-1, 3)
        out = push_out_strands(field, strands, GAP)
        moved = jnp.mean(jnp.any(out != strands, axis=2))
        name = f"{len(strands)} strands x {POINTS}, {100 * moved:.0f} % of points moved"
        measure(name, lambda s=strands: push_out_strands(field, s, GAP))
        some = np.asarray(out[::50, 1:], np.float64).reshape(-1, 3)
        least = 1e3 * signed_distance(head, some).min()
        print(f"  least distance from the mesh after it: {least:.2f} mm")
    measure("all points by push_out_points", lambda: push_out_points(field, flat, GAP))
    tree = make_tree()
    name = f"the skeletons of {tree.count} clusters"
    measure(name, lambda: push_out_tree(field, tree, GAP).cylinder.skeleton)


if __name__ == "__main__":
    main()
