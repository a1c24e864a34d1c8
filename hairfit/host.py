"""How NumPy counts, and from its arrays to JAX's."""

import contextlib
from collections.abc import Iterator
from typing import Any

import jax
import numpy as np
from jaxtyping import Array
from numpy.typing import DTypeLike
from threadpoolctl import threadpool_limits


@contextlib.contextmanager
def one_blas_thread() -> Iterator[None]:
    """Have NumPy and SciPy multiply matrices on one thread meanwhile.

    A million points times a 3 x 3 matrix take OpenBLAS five times as long on two
    threads as on one, and threads of `abreast` that multiply wait for each other.
    Larger matrices are JAX's, which has threads of its own.
    """
    with threadpool_limits(1, "blas"):
        yield


def on_device(values: Any, dtype: DTypeLike | Any = None) -> Array:
    """Return what the host holds as JAX's array, in the precision JAX computes with.

    As `jnp.asarray`, which compiles a program for each shape and type it is given
    (jax 0.10). Outside `jit` only; who changes `values` later may change the array.
    """
    return jax.device_put(np.asarray(values, dtype))


def more_rows(values: Any, count: int) -> np.ndarray:
    """Return an array of at least so many rows, the last one again and again.

    On the host: what is compiled for `count` rows then serves fewer as well.
    """
    values = np.asarray(values)
    spare = max(0, count - len(values))
    return np.pad(values, [(0, spare), *[(0, 0)] * (values.ndim - 1)], mode="edge")
