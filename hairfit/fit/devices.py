"""A refinement over several devices: photographs and strands are shared out."""

import math
from typing import TypeVar

import jax
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec

VIEWS, STRANDS = "views", "strands"
BY_VIEW, BY_STRAND = PartitionSpec(VIEWS), PartitionSpec(STRANDS)
BY_BOTH, EVERYWHERE = PartitionSpec(VIEWS, STRANDS), PartitionSpec()

Arrays = TypeVar("Arrays")


def device_mesh(views: int, strands: int) -> Mesh | None:
    """Return all devices as rows of photographs and columns of strands.

    As square as can be, and so that all devices get equally much; None if there is one
    device, or nothing divides.
    """
    devices = jax.devices()
    count = len(devices)
    rows = [
        row
        for row in range(1, math.isqrt(count) + 1)
        if count % row == 0 and views % row == 0 and strands % (count // row) == 0
    ]
    if count == 1 or not rows:
        return None
    return Mesh(np.array(devices).reshape(max(rows), -1), (VIEWS, STRANDS))


def put(mesh: Mesh | None, arrays: Arrays, where: PartitionSpec) -> Arrays:
    """Return arrays as they are shared out; as they are without a mesh."""
    if mesh is None:
        return arrays
    return jax.device_put(arrays, NamedSharding(mesh, where))
