"""Hair trees in files: `.hairtree`, described in `docs/formats.md`."""

import json
import zipfile
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..errors import InputError
from ..model.cylinder import GeneralizedCylinder
from ..model.scalp import Scalp
from ..model.tree import HairTree, ScalpContour
from .archive import DAMAGE, decode_array, encode_array, write_archive

VERSION = 1

# Arrays by name, with their axes: a number, or what the header says of clusters, knots.
ARRAYS: dict[str, tuple[str | int, ...]] = {
    "scalp/control": (13, 13, 3),
    "contour/centre": ("clusters", 2),
    "contour/radius": ("clusters",),
    "contour/offset": ("clusters", 32),
    "cylinder/skeleton": ("clusters", "knots", 3),
    "cylinder/normal": ("clusters", 3),
    "cylinder/radius": ("clusters", "knots"),
    "cylinder/offset": ("clusters", "knots", 32),
    "cylinder/scale": ("clusters", "knots", 2),
    "cylinder/twist": ("clusters", "knots"),
    "cylinder/shear": ("clusters", "knots"),
    "length_variation": ("clusters",),
}


def save_tree(path: Path | str, tree: HairTree) -> None:
    """Write a hair tree to a `.hairtree` file: the same tree, the same bytes.

    Args:
        path: The file.
        tree: The tree; its numbers are written as float32.

    Raises:
        InputError: If the suffix is another.
    """
    path = Path(path)
    if path.suffix != ".hairtree":
        raise InputError(f"trees are saved as .hairtree, not as '{path.name}'.")
    header = {
        "format": "hairtree",
        "version": VERSION,
        "units": {"length": "metre", "angle": "radian"},
        "clusters": len(tree.parent),
        "knots": int(tree.cylinder.skeleton.shape[1]),
        "parent": list(tree.parent),
    }
    entries = {"header.json": (json.dumps(header, indent=1) + "\n").encode()}
    for name in ARRAYS:
        value: Any = tree
        for part in name.split("/"):
            value = getattr(value, part)
        entries[f"{name}.npy"] = encode_array(np.asarray(value).astype("<f4"))
    write_archive(path, entries)


def load_tree(path: Path | str) -> HairTree:
    """Return the hair tree of a `.hairtree` file.

    Args:
        path: The file.

    Raises:
        InputError: If there is none, it is damaged, or a newer hairfit wrote it.
    """
    path = Path(path)
    if path.suffix != ".hairtree":
        raise InputError(f"'{path}' is not a tree; give a .hairtree file.")
    if not path.is_file():
        raise InputError(f"there is no '{path}'; check the path.")
    try:
        with zipfile.ZipFile(path) as archive:
            header = read_header(archive, path)
            arrays = {
                name: read_array(archive, name, axes, header, path)
                for name, axes in ARRAYS.items()
            }
        return build_tree(arrays, tuple(header["parent"]))
    except InputError:
        raise
    except DAMAGE as error:
        raise InputError(
            f"'{path}' is damaged or no .hairtree; copy or save it again."
        ) from error


def read_header(archive: zipfile.ZipFile, path: Path) -> dict[str, Any]:
    """Return the header, or refuse what is not a tree that can be read."""
    header = json.loads(archive.read("header.json"))
    if not isinstance(header, dict) or header.get("format") != "hairtree":
        raise InputError(f"'{path}' is no .hairtree: its header says otherwise.")
    version = header.get("version")
    if not isinstance(version, int) or version < 1:
        raise InputError(f"'{path}' is damaged: its version is {version!r}.")
    if version > VERSION:
        raise InputError(
            f"'{path}' is a .hairtree of version {version}, newer than {VERSION}, "
            "which this hairfit reads; update hairfit."
        )
    parent = header["parent"]
    sane = (
        isinstance(parent, list)
        and all(type(header[name]) is int for name in ("clusters", "knots"))
        and len(parent) == header["clusters"]
        and all(type(p) is int and -1 <= p < i for i, p in enumerate(parent))
    )
    if not sane:
        raise InputError(
            f"'{path}' is damaged: its clusters do not form a tree; save it again."
        )
    return header


def read_array(
    archive: zipfile.ZipFile,
    name: str,
    axes: tuple[str | int, ...],
    header: dict[str, Any],
    path: Path,
) -> np.ndarray:
    """Return one array, or refuse it if it is not as the header says."""
    shape = tuple(header[axis] if isinstance(axis, str) else axis for axis in axes)
    array = decode_array(archive.read(f"{name}.npy"))
    if array.shape != shape or array.dtype != np.dtype("<f4"):
        raise InputError(
            f"'{path}' is damaged: `{name}` is {array.dtype} of shape {array.shape}, "
            f"not float32 of shape {shape}; save it again."
        )
    if not np.isfinite(array).all():
        raise InputError(
            f"'{path}' is damaged: `{name}` holds numbers that are not finite; save it "
            "again."
        )
    return array


def build_tree(arrays: dict[str, np.ndarray], parent: tuple[int, ...]) -> HairTree:
    """Return the tree that the arrays describe."""

    def part(group: str) -> dict[str, Any]:
        names = [name for name in ARRAYS if name.startswith(group + "/")]
        return {name.split("/")[1]: jnp.asarray(arrays[name]) for name in names}

    return HairTree(
        scalp=Scalp(**part("scalp")),
        contour=jax.vmap(lambda one: ScalpContour(**one))(part("contour")),
        cylinder=jax.vmap(lambda one: GeneralizedCylinder(**one))(part("cylinder")),
        length_variation=jnp.asarray(arrays["length_variation"]),
        parent=parent,
    )
