"""How close trees come to the strands that they were made from, and what they cost.

Run `python benchmarks/treeify.py [CAPTURE ...] [--leaves 30,100,500,1500]
[--wisps 1000]`. The strands of a capture's `truth.npz` become trees. Strands grown from
a tree at the roots of the input, and as many at roots sampled anew, are compared with
the input: unsigned F at 2 mm/20 degrees and 3 mm/30 degrees, all points and all
neighbours. Prints a Markdown table.
"""

import argparse
import pathlib
import resource
import tempfile
import time

import jax
import jax.numpy as jnp
import numpy as np
from strands import machine

from hairfit.evaluate import score
from hairfit.fit.root_scalp import scalp_for
from hairfit.fit.treeify import TreeifyConfig, treeify
from hairfit.io.mesh import load_mesh
from hairfit.io.strands import load_strands
from hairfit.io.tree import save_tree
from hairfit.model import HairTree, grow_strands, leaves, sample_strands
from hairfit.types import Strands

CAPTURES = pathlib.Path(__file__).parents[2] / "shared" / "captures"
NAMES = ("ruby", "ponytail", "walk")
THRESHOLDS = ((2e-3, 20.0), (3e-3, 30.0))
POINTS = 48


def scores(strands, truth: Strands) -> str:
    """Return F at both thresholds, in percent."""
    found = score(Strands.from_array(np.asarray(strands)), truth, THRESHOLDS)
    return ", ".join(f"{100 * one.unsigned.f:.1f}" for one in found)


def file_size(tree: HairTree) -> float:
    """Return the size of a tree's file, in kB."""
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "tree.hairtree"
        save_tree(path, tree)
        return path.stat().st_size / 1e3


def row(capture: pathlib.Path, config: TreeifyConfig) -> str:
    """Make a tree of one capture's strands, and return its row of the table."""
    truth = load_strands(capture / "truth.npz")
    head = load_mesh(capture / "head.obj")
    start = time.perf_counter()
    scalp = scalp_for(head, truth)
    found = treeify(truth, scalp, config)
    seconds = time.perf_counter() - start
    tree = found.tree
    uv, eta = jnp.asarray(found.uv, jnp.float32), jnp.asarray(found.eta, jnp.float32)
    owner = jnp.asarray(found.owner, jnp.int32)
    regrown = grow_strands(tree, uv, owner, eta, POINTS)
    anew = sample_strands(tree, truth.count, POINTS, jax.random.key(0))
    parts = jax.tree.leaves((tree.contour, tree.cylinder, tree.length_variation))
    cells = (
        capture.name,
        str(truth.count),
        f"{len(leaves(tree))}",
        f"{tree.count}",
        f"{0 if tree.wisps is None else len(tree.wisps.owner)}",
        scores(regrown, truth),
        scores(anew, truth),
        f"{seconds:.1f} s",
        f"{sum(x.nbytes for x in parts) / tree.count / 1e3:.2f} kB",
        f"{file_size(tree):.0f} kB",
    )
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("captures", nargs="*", type=pathlib.Path)
    parser.add_argument("--leaves", default="30,100,500,1500")
    parser.add_argument("--wisps", type=int, default=TreeifyConfig().wisps)
    parser.add_argument("--steps", type=int, default=TreeifyConfig().steps)
    given = parser.parse_args()
    captures = given.captures or [CAPTURES / name for name in NAMES]
    there = [one for one in captures if (one / "truth.npz").is_file()]
    for one in captures:
        if one not in there:
            print(f"no truth.npz in {one}: left out")
    if not there:
        return
    print(machine() + "\n")
    print(
        "| capture | strands | leaves | clusters | wisps | F regrown at 2 mm/20°, "
        "3 mm/30° | F sampled anew | time | memory a cluster | file |"
    )
    print("|---" * 10 + "|")
    for capture in there:
        for count in given.leaves.split(","):
            config = TreeifyConfig(
                leaves=int(count), wisps=given.wisps, steps=given.steps
            )
            print(row(capture, config), flush=True)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    print(f"\npeak memory {peak:.1f} GB, with the comparison")


if __name__ == "__main__":
    main()
