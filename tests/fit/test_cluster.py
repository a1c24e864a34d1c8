import jax
import jax.numpy as jnp
import numpy as np
from ball_hair import RADIUS, dome

from hairfit.fit.cluster import kmeans, scalp_metric
from hairfit.model import ScalpContour, scalp_point


def test_groups_far_apart_are_told_apart_and_none_is_asked_for_in_vain():
    rng = np.random.default_rng(0)
    group = np.repeat(np.arange(4), 50)
    features = rng.normal(size=(200, 3)) + 100.0 * group[:, None]
    # As many starts as that lie in all groups.
    label = kmeans(features, 40, np.random.default_rng(1))
    shared = [set(label[group == g]) & set(label[group != g]) for g in range(4)]
    assert not any(shared)
    assert (kmeans(features, 1, rng) == 0).all()
    assert len(np.unique(kmeans(features[:3], 10, rng))) <= 3


def test_the_metric_is_the_root_of_the_scalps_area():
    scalp = dome()
    centre = jnp.array([[0.5, 0.5], [0.3, 0.6]])
    contour = jax.vmap(ScalpContour)(centre, jnp.full(2, 0.1), jnp.zeros((2, 32)))
    step = 1e-4
    for found, at in zip(scalp_metric(scalp, contour), centre, strict=True):
        corners = [
            np.asarray(scalp_point(scalp, at + step * jnp.array(d)))
            for d in ([0.0, 0.0], [1.0, 0.0], [0.0, 1.0])
        ]
        area = np.linalg.norm(
            np.cross(corners[1] - corners[0], corners[2] - corners[0])
        )
        assert np.isclose(found, np.sqrt(area) / step, rtol=1e-3)
        assert RADIUS < found < 4 * RADIUS
