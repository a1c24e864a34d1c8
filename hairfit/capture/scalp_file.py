"""`scalp.json`: the scalp of a capture, kept so that a hand may correct it."""

import json
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from ..errors import InputError
from ..model.scalp import Scalp


def save_scalp(path: Path, scalp: Scalp) -> None:
    """Write a scalp as JSON: 13x13 control points, in metres."""
    rows = [
        "  " + json.dumps(np.asarray(row, np.float64).round(6).tolist())
        for row in scalp.control
    ]
    path.write_text(
        '{\n "units": "metre",\n "control": [\n' + ",\n".join(rows) + "\n ]\n}\n",
        encoding="utf-8",
    )


def load_scalp(path: Path) -> Scalp:
    """Return the scalp of a JSON file that `save_scalp` wrote, or a hand changed.

    Raises:
        InputError: If the file is not JSON with 13x13 points in metres.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        control = np.asarray(content["control"], np.float64)
        units = content.get("units", "metre")
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"'{path}' is not JSON with 13x13 points under 'control'; remove it, and "
            "hairfit will wrap a scalp over the head."
        ) from error
    if control.shape != (13, 13, 3) or not np.isfinite(control).all():
        raise InputError(
            f"'{path}' must hold 13x13 finite points under 'control', not "
            f"{'x'.join(map(str, control.shape))}; mend or remove it."
        )
    if units != "metre":
        raise InputError(
            f"'{path}' is in '{units}'; write the points in metres, and 'metre' under "
            "'units'."
        )
    return Scalp(jnp.asarray(control))
