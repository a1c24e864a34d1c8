"""Hair from whatever holds it: results, trees, files of strands."""

from pathlib import Path

import numpy as np

from ..errors import InputError
from ..fit import derive_strands
from ..io.strands import load_strands
from ..io.tree import load_tree
from ..model.tree import HairTree
from ..render.studio import shared_width
from ..types import Strands
from .pictures import hexadecimal
from .result import is_result, read_report


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
        return derive_strands(load_tree(path), None, count, points, 0)
    return load_strands(path)


def own_colour(path: Path) -> str | None:
    """Return the mean colour that is painted on a hairstyle, as `#7a4a2b`, or None."""
    if not is_result(path) and path.suffix != ".hairtree":
        return None
    maps = read_tree(path).maps
    if maps is None:
        return None
    return hexadecimal(np.asarray(maps.colour, np.float64).mean(axis=(0, 1)))


def own_width(path: Path, count: int) -> float | None:
    """Return how wide so many strands of a result cover its masks, None if unknown.

    In metres.
    """
    if not is_result(path):
        return None
    looks = read_report(path).get("looks") or {}
    total = looks.get("total_width")
    return None if total is None else shared_width(float(total), count)


def must_exist(path: Path) -> None:
    """Refuse a path where there is nothing."""
    if not path.exists():
        raise InputError(f"there is no '{path}'; check the path.")
