"""Recover an editable hair tree from a few photographs.

What is public here is imported when it is first used, so that `import hairfit` is
fast and pulls none of the heavy libraries.
"""

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .errors import InputError as InputError
    from .model import GeneralizedCylinder as GeneralizedCylinder
    from .model import HairTree as HairTree
    from .model import Scalp as Scalp
    from .model import ScalpContour as ScalpContour
    from .model import find_owner as find_owner
    from .model import grow_strands as grow_strands
    from .model import plant as plant
    from .model import sample_strands as sample_strands
    from .types import Mesh as Mesh
    from .types import Strands as Strands

__version__ = "0.1.0"

HOME = {
    "InputError": "errors",
    "Mesh": "types",
    "Strands": "types",
    "GeneralizedCylinder": "model",
    "HairTree": "model",
    "Scalp": "model",
    "ScalpContour": "model",
    "find_owner": "model",
    "grow_strands": "model",
    "plant": "model",
    "sample_strands": "model",
}
__all__ = [*HOME]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str):
    if name not in HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f".{HOME[name]}", __name__), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *HOME})
