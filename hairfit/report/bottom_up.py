"""Strands of a file become a tree in a file."""

from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..fit.fill_in import fill_in
from ..fit.root_scalp import scalp_for
from ..fit.treeify import TreeifyConfig, treeify
from ..io.mesh import load_mesh
from ..io.strands import load_strands
from ..io.tree import save_tree
from ..types import Strands
from .hairstyles import must_exist
from .progress import Progress


def treeify_file(
    strands: Path,
    out: Path,
    config: TreeifyConfig,
    *,
    head: Path | None = None,
    scale: float = 1.0,
    fill: float = 0.0,
    progress: Progress = lambda stage, share: None,
) -> dict[str, Any]:
    """Write the hair tree of a file of strands, and return figures about it.

    Args:
        strands: The strands.
        out: The tree.
        config: Numbers of clusters, levels and wisps.
        head: The mesh that the strands grow on; None has the scalp follow their roots.
        scale: What coordinates of the strands are multiplied by, to be metres.
        fill: Gaps of up to this radius get hair, in metres; 0 leaves them.
        progress: Called with what is being done and the share that is done.

    Raises:
        InputError: If something cannot be read, or is no hair in metres.
    """
    if out.suffix != ".hairtree":
        raise InputError(f"--out '{out}' must end with .hairtree; rename it.")
    if not (np.isfinite(scale) and scale > 0.0):
        raise InputError(f"--scale must be a positive number, not {scale}.")
    if not (np.isfinite(fill) and fill >= 0.0):
        raise InputError(f"--fill must be at least 0, not {fill}; give it in metres.")
    must_exist(strands)
    progress("reading the strands", 0.0)
    given = load_strands(strands)
    given = Strands((scale * given.points).astype(np.float32), given.offsets)
    mesh = None if head is None else load_mesh(head)
    progress("wrapping the scalp", 0.1)
    scalp = scalp_for(mesh, given)
    progress("gathering strands", 0.3)
    made = treeify(given, scalp, config)
    tree = fill_in(made.tree, made.uv, fill) if fill else made.tree
    progress("writing the tree", 0.95)
    save_tree(out, tree)
    progress("done", 1.0)
    wisps = 0 if made.tree.wisps is None else len(made.tree.wisps.owner)
    return {"clusters": made.tree.count, "wisps": wisps, **made.figures}
