"""What a capture, a result, a tree or a file of strands holds, in figures."""

from pathlib import Path
from typing import Any

import numpy as np

from ..capture.cameras import read_cameras
from ..capture.photos import find_photos
from ..errors import InputError
from ..io.strands import load_strands
from ..io.tree import load_tree
from ..model.tree import HairTree
from ..types import Strands
from .hairstyles import must_exist
from .result import is_result, read_report


def describe(path: Path) -> dict[str, Any]:
    """Return facts about a path, by name.

    Raises:
        InputError: If it holds nothing that hairfit knows.
    """
    must_exist(path)
    if path.suffix == ".hairtree":
        return {"kind": "tree", **tree_facts(load_tree(path))}
    if path.suffix in (".hair", ".npz"):
        return {"kind": "strands", **strand_facts(load_strands(path))}
    if path.is_dir() and is_result(path):
        report = read_report(path)
        return {
            "kind": "result",
            "capture": report["capture"],
            "views": report["views"],
            "settings": report["settings"],
            "tree": tree_facts(load_tree(path / "tree.hairtree")),
            "hair": strand_facts(load_strands(path / "strands.hair")),
            "figures": report["figures"],
        }
    if (path / "cameras.json").is_file():
        return {"kind": "capture", **capture_facts(path)}
    raise InputError(
        f"'{path}' is neither a capture, a result, a tree (.hairtree) nor strands "
        "(.hair, .npz); check the path."
    )


def tree_facts(tree: HairTree) -> dict[str, Any]:
    """Return figures of a tree."""
    depth: list[int] = []
    for parent in tree.parent:
        depth.append(0 if parent < 0 else depth[parent] + 1)
    skeleton = np.asarray(tree.cylinder.skeleton)
    length = np.linalg.norm(np.diff(skeleton, axis=1), axis=2).sum(axis=1)
    return {
        "clusters": len(depth),
        "clusters_per_level": np.bincount(depth).tolist(),
        "knots": skeleton.shape[1],
        "mean_length_m": float(length.mean()),
        "wisps": 0 if tree.wisps is None else len(tree.wisps.owner),
        "maps": "no" if tree.maps is None else "yes",
    }


def strand_facts(strands: Strands) -> dict[str, Any]:
    """Return figures of strands."""
    steps = np.linalg.norm(np.diff(strands.points.astype(np.float64), axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    first, last = strands.offsets[:-1], strands.offsets[1:] - 1
    length = along[last] - along[first]
    return {
        "strands": strands.count,
        "points": len(strands.points),
        "mean_length_m": float(length.mean()),
        "longest_m": float(length.max()),
        "low_m": strands.points.min(axis=0).tolist(),
        "high_m": strands.points.max(axis=0).tolist(),
    }


def capture_facts(folder: Path) -> dict[str, Any]:
    """Return what a capture folder holds."""
    entries = read_cameras(folder / "cameras.json")
    photos = find_photos(folder / "images")
    sizes = sorted({f"{e.camera.width}x{e.camera.height}" for e in entries})
    masks = {
        part: sum((folder / "masks" / part / f"{e.name}.png").exists() for e in entries)
        for part in ("hair", "body")
    }
    present = {
        name: (folder / name).exists()
        for name in ("head.obj", "scalp.json", "truth.npz")
    }
    return {
        "views": [entry.name for entry in entries],
        "sizes": sizes,
        "photographs": len(photos),
        "masks": masks,
        **{name: "yes" if there else "no" for name, there in present.items()},
    }
