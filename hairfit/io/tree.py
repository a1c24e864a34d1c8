"""Hair trees in files: `.hairtree`, described in `docs/formats.md`."""

import json
import zipfile
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ..errors import InputError
from ..host import on_device
from ..model.certainty import TreeConfidence
from ..model.cylinder import GeneralizedCylinder
from ..model.locks import Locks
from ..model.maps import ScalpMaps
from ..model.scalp import Scalp
from ..model.tree import HairTree, ScalpContour
from ..model.wisp import Wisps
from .archive import DAMAGE, decode_array, encode_array, write_archive
from .steps import from_steps, to_steps

VERSION = 2
# A cluster thinner than this is treated as so thick where steps depend on it. Metres.
THINNEST = 0.0004


class Entry(NamedTuple):
    """One array of the file.

    Attributes:
        axes: Its shape: numbers, or names of counts in the header.
        step: What its values are rounded to.
        differences: How often it is differenced along the second axis.
        given: What must be known to read it: "reach" divides the step by the cluster's
            mean radius, "contour" takes the scalp's contour, as large as the knot's
            radius, off the values.
    """

    axes: tuple[str | int, ...]
    step: float
    differences: int = 0
    given: str = ""


# In the order in which they can be read.
TREE: dict[str, Entry] = {
    "scalp/control": Entry((13, 13, 3), 1e-6, 2),
    "contour/centre": Entry(("clusters", 2), 2.0**-16),
    "contour/radius": Entry(("clusters",), 2.0**-14),
    "contour/offset": Entry(("clusters", 32), 2.0**-12, 1),
    "cylinder/skeleton": Entry(("clusters", "knots", 3), 5e-5, 2),
    "cylinder/normal": Entry(("clusters", 3), 2.0**-13),
    "cylinder/radius": Entry(("clusters", "knots"), 1e-5, 1),
    "cylinder/offset": Entry(("clusters", "knots", 32), 2e-5, 1, "contour"),
    "cylinder/scale": Entry(("clusters", "knots", 2), 2.5e-5, 1, "reach"),
    "cylinder/twist": Entry(("clusters", "knots"), 2.5e-5, 1, "reach"),
    "cylinder/shear": Entry(("clusters", "knots"), 2.5e-5, 1, "reach"),
    "length_variation": Entry(("clusters",), 2.0**-10),
}
WISPS: dict[str, Entry] = {
    "wisps/uv": Entry(("wisps", 2), 2.0**-16),
    "wisps/owner": Entry(("wisps",), 1.0),
    "wisps/offset": Entry(("wisps", "knots", 3), 5e-5, 1),
}
MAPS: dict[str, Entry] = {
    "maps/density": Entry(("rows", "columns"), 2.0**-10, 1),
    "maps/length": Entry(("rows", "columns"), 2.0**-10, 1),
    "maps/thickness": Entry(("rows", "columns"), 1e-7, 1),
    "maps/colour": Entry(("rows", "columns", 3), 2.0**-12, 1),
    "maps/curl": Entry(("rows", "columns"), 1e-5, 1),
}
CONFIDENCE: dict[str, Entry] = {
    "confidence/sigma_position": Entry(("clusters",), 1e-5),
    "confidence/sigma_angle": Entry(("clusters",), 2.0**-11),
    "confidence/photographed": Entry(("clusters",), 2.0**-8),
}
LOCKS: dict[str, Entry] = {
    "locks/phase": Entry(("clusters", "knots"), 2.0**-6, 1),
    "locks/hand": Entry(("clusters",), 1.0),
    "locks/pitch": Entry(("clusters",), 2.0**-7),
}
COUNTS = {"wisps": ("wisps",), "maps": ("rows", "columns")}


def entries_of(header: dict[str, Any]) -> dict[str, Entry]:
    """Return the arrays that a file with this header has."""
    wisps = WISPS if "wisps" in header else {}
    maps = MAPS if "rows" in header else {}
    confidence = CONFIDENCE if header.get("confidence") else {}
    locks = LOCKS if header.get("locks") else {}
    return {**TREE, **wisps, **maps, **confidence, **locks}


def save_tree(path: Path | str, tree: HairTree, *, exact: bool = False) -> None:
    """Write a hair tree to a `.hairtree` file: the same tree, the same bytes.

    Numbers are rounded to steps below the width of a hair: 0.05 mm for skeletons and
    less for cross-sections. `docs/formats.md` has them all.

    Args:
        path: The file.
        tree: The tree.
        exact: Write every number as float32, some ten times larger.

    Raises:
        InputError: If the suffix is another, or numbers are not finite or far too
            large for hair.
    """
    path = Path(path)
    if path.suffix != ".hairtree":
        raise InputError(f"trees are saved as .hairtree, not as '{path.name}'.")
    header = header_of(tree) | {"encoding": "float32" if exact else "steps"}
    arrays = arrays_of(tree, header)
    if not exact:
        known: dict[str, np.ndarray] = {}
        for name, entry in entries_of(header).items():
            arrays[name] = encode(arrays[name], entry, known)
            known[name] = decode(arrays[name], entry, known)
    indent = None if len(tree.parent) > 100 else 1
    content = {"header.json": (json.dumps(header, indent=indent) + "\n").encode()}
    content |= {f"{name}.npy": encode_array(one) for name, one in arrays.items()}
    write_archive(path, content, compress=not exact)


def round_tree(tree: HairTree) -> HairTree:
    """Return the tree as `load_tree` would after `save_tree`, in float32."""
    header = header_of(tree)
    arrays = arrays_of(tree, header)
    known: dict[str, np.ndarray] = {}
    for name, entry in entries_of(header).items():
        known[name] = decode(encode(arrays[name], entry, known), entry, known)
    return build_tree(known, header)


def header_of(tree: HairTree) -> dict[str, Any]:
    """Return the header of a tree's file, but for its encoding."""
    header: dict[str, Any] = {
        "format": "hairtree",
        "version": VERSION,
        "units": {"length": "metre", "angle": "radian"},
        "clusters": len(tree.parent),
        "knots": int(tree.cylinder.skeleton.shape[1]),
        "parent": list(tree.parent),
    }
    if tree.wisps is not None:
        header["wisps"] = len(tree.wisps.owner)
    if tree.maps is not None:
        header["rows"], header["columns"] = tree.maps.density.shape
    if tree.confidence is not None:
        header["confidence"] = True
    if tree.locks is not None:
        header["locks"] = True
    return header


def arrays_of(tree: HairTree, header: dict[str, Any]) -> dict[str, np.ndarray]:
    """Return the arrays of a tree as float32, or refuse what cannot be saved."""
    arrays = {}
    for name in entries_of(header):
        value: Any = tree
        for part in name.split("/"):
            value = getattr(value, part)
        arrays[name] = np.asarray(value).astype("<f4")
        if not np.isfinite(arrays[name]).all():
            raise InputError(
                f"the tree cannot be saved: `{name}` holds numbers that are not "
                "finite; undo what made them."
            )
    return arrays


def encode(array: np.ndarray, entry: Entry, known: dict[str, np.ndarray]) -> np.ndarray:
    """Return an array as planes of bytes, given those that are read before it."""
    base, size = given_of(entry, known)
    try:
        return to_steps((array - base) * size, entry.step, entry.differences)
    except ValueError as error:
        raise InputError(
            "the tree cannot be saved: it holds numbers far too large for hair; undo "
            "what made them."
        ) from error


def decode(
    planes: np.ndarray, entry: Entry, known: dict[str, np.ndarray]
) -> np.ndarray:
    """Return the float32 array of planes of bytes."""
    base, size = given_of(entry, known)
    values = from_steps(planes, entry.step, entry.differences) / size + base
    return values.astype("<f4")


class Given(NamedTuple):
    """What is taken off an array and what then multiplies it before it is rounded."""

    base: np.ndarray
    size: np.ndarray


def given_of(entry: Entry, known: dict[str, np.ndarray]) -> Given:
    """Return what is known of an array from those that are read before it."""
    nothing, same = np.zeros(()), np.ones(())
    if not entry.given:
        return Given(nothing, same)
    radius = known["cylinder/radius"].astype(np.float64)
    if entry.given == "reach":
        reach = np.maximum(np.abs(radius).mean(axis=1), THINNEST)
        return Given(nothing, reach.reshape(-1, *[1] * (len(entry.axes) - 1)))
    own = known["contour/radius"].astype(np.float64)
    shape = known["contour/offset"] / np.where(own == 0.0, np.inf, own)[:, None]
    return Given(radius[:, :, None] * shape[:, None, :], same)


def load_tree(path: Path | str) -> HairTree:
    """Return the hair tree of a `.hairtree` file of this or an older version.

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
            arrays: dict[str, np.ndarray] = {}
            for name, entry in entries_of(header).items():
                arrays[name] = read_array(archive, name, entry, header, arrays, path)
        return build_tree(arrays, header)
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
    if type(version) is not int or version < 1:
        raise InputError(f"'{path}' is damaged: its version is {version!r}.")
    if version > VERSION:
        raise InputError(
            f"'{path}' is a .hairtree of version {version}, newer than {VERSION}, "
            "which this hairfit reads; update hairfit."
        )
    # Version 1 had no other encoding, no wisps and no maps.
    header.setdefault("encoding", "float32")
    parent = header["parent"]
    counts = ["clusters", "knots"]
    for names in COUNTS.values():
        counts += names if any(name in header for name in names) else ()
    sane = (
        header["encoding"] in ("float32", "steps")
        and isinstance(parent, list)
        and all(type(header[name]) is int and header[name] >= 0 for name in counts)
        and len(parent) == header["clusters"]
        and header.get("confidence", True) is True
        and header.get("locks", True) is True
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
    entry: Entry,
    header: dict[str, Any],
    known: dict[str, np.ndarray],
    path: Path,
) -> np.ndarray:
    """Return one array, or refuse it if it is not as the header says."""
    shape = tuple(
        header[axis] if isinstance(axis, str) else axis for axis in entry.axes
    )
    array = decode_array(archive.read(f"{name}.npy"))
    found, kind = array.shape, "float32"
    fits = array.dtype == np.dtype("<f4")
    if header["encoding"] == "steps":
        found, kind = array.shape[1:], "planes of bytes"
        fits = array.dtype == np.uint8 and 1 <= array.shape[0] <= 5
    if found != shape or not fits:
        raise InputError(
            f"'{path}' is damaged: `{name}` is {array.dtype} of shape {found}, "
            f"not {kind} of shape {shape}; save it again."
        )
    if header["encoding"] == "steps":
        return decode(array, entry, known)
    if not np.isfinite(array).all():
        raise InputError(
            f"'{path}' is damaged: `{name}` holds numbers that are not finite; save it "
            "again."
        )
    return array


def build_tree(arrays: dict[str, np.ndarray], header: dict[str, Any]) -> HairTree:
    """Return the tree that the arrays describe.

    Raises:
        ValueError: If a wisp belongs to no cluster.
    """

    def part(group: str) -> dict[str, Any]:
        names = [name for name in arrays if name.startswith(group + "/")]
        return {name.split("/")[1]: on_device(arrays[name]) for name in names}

    wisps = maps = confidence = locks = None
    if "wisps" in header:
        content = part("wisps")
        owner = content["owner"].astype(jnp.int32)
        if not ((owner >= 0) & (owner < header["clusters"])).all():
            raise ValueError("a wisp belongs to no cluster.")
        wisps = Wisps(**(content | {"owner": owner}))
    if "rows" in header:
        maps = ScalpMaps(**part("maps"))
    if header.get("confidence"):
        confidence = TreeConfidence(**part("confidence"))
    if header.get("locks"):
        locks = Locks(**part("locks"))
    return HairTree(
        scalp=Scalp(**part("scalp")),
        contour=jax.vmap(lambda one: ScalpContour(**one))(part("contour")),
        cylinder=jax.vmap(lambda one: GeneralizedCylinder(**one))(part("cylinder")),
        length_variation=on_device(arrays["length_variation"]),
        parent=tuple(header["parent"]),
        wisps=wisps,
        maps=maps,
        confidence=confidence,
        locks=locks,
    )
