"""From NumPy's arrays to JAX's."""

from typing import Any

import jax
import numpy as np
from jaxtyping import Array
from numpy.typing import DTypeLike


def on_device(values: Any, dtype: DTypeLike | Any = None) -> Array:
    """Return what the host holds as JAX's array, in the precision JAX computes with.

    As `jnp.asarray`, which compiles a program for each shape and type it is given
    (jax 0.10). Outside `jit` only; who changes `values` later may change the array.
    """
    return jax.device_put(np.asarray(values, dtype))
