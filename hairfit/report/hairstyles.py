"""Hair from whatever holds it: results, trees, files of strands."""

from pathlib import Path

import jax
import numpy as np

from ..errors import InputError
from ..io.strands import load_strands
from ..io.tree import load_tree
from ..model.strand import sample_strands
from ..model.tree import HairTree
from ..types import Strands
from .result import is_result


def read_tree(path: Path) -> HairTree:
    """Return the tree of a `.hairtree` file or a result.

    Raises:
        InputError: If there is none.
    """
    if path.is_dir():
        if not is_result(path):
            raise InputError(
                f"'{path}' is not a result of hairfit; give one, or a .hairtree file."
            )
        path = path / "tree.hairtree"
    return load_tree(path)


def read_strands(path: Path, *, count: int = 10_000, points: int = 32) -> Strands:
    """Return the strands of a file or a result, or some that grow from a tree.

    Args:
        path: A result, a tree or strands.
        count: How many strands to grow from a tree.
        points: How many points these have.

    Raises:
        InputError: If there is no hair.
    """
    if path.suffix == ".hairtree":
        return tree_strands(load_tree(path), count, points, 0)
    return load_strands(path)


def tree_strands(tree: HairTree, count: int, points: int, seed: int) -> Strands:
    """Return strands that grow from a tree."""
    grown = sample_strands(tree, count, points, jax.random.key(seed))
    if not len(grown):
        raise InputError(
            "no strand grows from the tree: its clusters cover nothing of the scalp; "
            "fit it again."
        )
    return Strands.from_array(np.asarray(grown, np.float32))


def must_exist(path: Path) -> None:
    """Refuse a path where there is nothing."""
    if not path.exists():
        raise InputError(f"there is no '{path}'; check the path.")
