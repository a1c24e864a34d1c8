"""What all ways of clustering strands share: k-means, and where clusters are rooted."""

import warnings

import jax
import numpy as np
from jaxtyping import Float, Int
from scipy.cluster.vq import kmeans2

from ..host import more_rows, on_device
from ..model.cylinder import together
from ..model.scalp import Scalp, scalp_tangents
from ..model.tree import ScalpContour

_tangents_on = jax.jit(jax.vmap(scalp_tangents, (None, 0)))


def scalp_metric(scalp: Scalp, contour: ScalpContour) -> Float[np.ndarray, " clusters"]:
    """Return metres on the scalp for 1 of scalp space at each contour's centre."""
    # Filled up, so that trees of about as many clusters share a program.
    count = len(contour.centre)
    centre = more_rows(contour.centre, together(count))
    tangents = _tangents_on(scalp, on_device(centre))
    area = np.cross(np.asarray(tangents.u), np.asarray(tangents.v))[:count]
    return np.sqrt(np.linalg.norm(area, axis=1))


def kmeans(
    features: Float[np.ndarray, "strands features"], count: int, rng
) -> Int[np.ndarray, " strands"]:
    """Return the cluster of each strand by k-means; clusters may lack strands."""
    count = min(count, len(features))
    if count <= 1:
        return np.zeros(len(features), int)
    start = features[rng.choice(len(features), count, replace=False)]
    with warnings.catch_warnings():
        # A cluster that loses all its strands is left out by the caller.
        warnings.filterwarnings("ignore", "One of the clusters is empty")
        return kmeans2(features, start, iter=12, minit="matrix", missing="warn")[1]
