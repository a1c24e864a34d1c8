"""How long it takes to find the owners of roots, and to subdivide a cluster.

Run `python benchmarks/ownership.py`. The tree is that of `strands.py`: 40 root
clusters, 300 below them and 1 000 leaves. The target is 0.5 s for 100 000 roots.
"""

import jax
import numpy as np
from strands import ROOTS, machine, make_tree, measure

from hairfit import model
from hairfit.model.subdivide import subdivide
from hairfit.model.tiling import part_tree

CHILDREN = 16


def main() -> None:
    """Print all figures."""
    print(machine())
    tree = make_tree()
    uv = model.sample_roots(tree.scalp, ROOTS, jax.random.key(0))
    measure(
        f"owners of {ROOTS} roots among {tree.count} clusters",
        lambda: model.find_owner(tree, uv),
    )
    top = model.take(tree, np.asarray(tree.parent) < 0)
    measure(
        f"the same among {top.count} root clusters", lambda: model.find_owner(top, uv)
    )
    key = jax.random.key(1)
    measure(
        f"subdivide a leaf into {CHILDREN}",
        lambda: subdivide(tree, tree.count - 1, CHILDREN, key).cylinder.skeleton,
    )
    border = np.array([[0.5, 0.0], [0.5, 1.0]])
    measure(
        f"cut {tree.count} clusters at a parting",
        lambda: part_tree(tree, [border]).contour.offset,
    )


if __name__ == "__main__":
    main()
