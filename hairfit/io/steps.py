"""Numbers in steps: rounded, differenced and cut into bytes that compress well."""

import numpy as np
from jaxtyping import Float, UInt8

LARGEST = 2**31 - 1


def to_steps(
    values: Float[np.ndarray, "..."], step: float, differences: int
) -> UInt8[np.ndarray, "_planes ..."]:
    """Return values as whole steps, in planes of bytes, the lowest first.

    Args:
        values: The values.
        step: What they are rounded to.
        differences: How often neighbours along the second axis are subtracted: smooth
            values become small.

    Raises:
        ValueError: If a value is not finite or takes more than four bytes.
    """
    share = np.asarray(values, np.float64) / step
    if not (np.abs(share) < LARGEST / 2**differences).all():
        raise ValueError(f"values must be finite and below {LARGEST} steps of {step}.")
    whole = np.rint(share).astype(np.int64)
    for _ in range(differences):
        whole = np.diff(whole, axis=1, prepend=0)
    # 0, -1, 1, -2 ... become 0, 1, 2, 3: small numbers have empty high bytes.
    folded = np.where(whole >= 0, 2 * whole, -2 * whole - 1)
    count = max(1, (int(folded.max(initial=0)).bit_length() + 7) // 8)
    return np.stack([(folded >> (8 * i)) & 0xFF for i in range(count)]).astype(np.uint8)


def from_steps(
    planes: UInt8[np.ndarray, "_planes ..."], step: float, differences: int
) -> Float[np.ndarray, "..."]:
    """Return the values of `to_steps`, each within half a step."""
    folded = np.zeros(planes.shape[1:], np.int64)
    for i, plane in enumerate(planes):
        folded |= plane.astype(np.int64) << (8 * i)
    whole = np.where(folded & 1, -(folded >> 1) - 1, folded >> 1)
    for _ in range(differences):
        whole = np.cumsum(whole, axis=1)
    return whole * step
