import threading

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from ball_hair import HEIGHT, RADIUS, WIDTH, ball, dome, hull_where, photograph, ring

from hairfit.fit.ahead import (
    Shapes,
    compile_growth,
    compile_refinement,
    compiling_ahead,
)
from hairfit.fit.evidence import Field
from hairfit.fit.refine import (
    Photographs,
    RefineConfig,
    Samples,
    descend,
    move,
    refine,
)
from hairfit.fit.residuals import photo_maps
from hairfit.fit.volume import hair_volume
from hairfit.model import (
    HairTree,
    ScalpContour,
    find_owner,
    grow_strands,
    plant,
    sample_roots,
)
from hairfit.model.scalp import normals_on, points_on

CONFIG = RefineConfig(rounds=2, steps=2, strands=300, points=9)
KNOTS = 7


def programs(*functions):
    """Return how many programs each function was compiled to so far."""
    return [f._cache_size() for f in functions]  # pyright: ignore


def test_what_is_called_ahead_is_called_in_order_on_another_thread():
    said, here = [], threading.get_ident()

    def say(word):
        said.append((word, threading.get_ident() == here))

    with compiling_ahead() as ahead:
        ahead(say, "one")
        ahead(say, "two")
    assert said == [("one", False), ("two", False)]


def test_what_fails_ahead_is_not_lost():
    def fail():
        raise ValueError("no room")

    with pytest.raises(ValueError, match="no room"), compiling_ahead() as ahead:
        ahead(fail)


def test_growing_compiles_nothing_anew():
    compile_growth(321, (123,))
    before = programs(sample_roots, points_on, normals_on)
    for count in (321, 123):
        uv = sample_roots(dome(), count, jax.random.key(5))
    uv = sample_roots(dome(), 321, jax.random.key(5))
    points_on(dome(), uv)
    normals_on(dome(), uv)
    assert programs(sample_roots, points_on, normals_on) == before


@pytest.mark.slow
def test_a_refinement_compiles_nothing_anew():
    """Whatever it is: of photographs, a tree and a hull of the shapes said before."""
    contour = jax.vmap(ScalpContour)(
        jnp.array([[0.35, 0.4], [0.65, 0.6], [0.6, 0.6]]),
        jnp.array([0.3, 0.3, 0.2]),
        jnp.zeros((3, 32)),
    )
    planted = jax.vmap(lambda c: plant(dome(), c, 0.1, KNOTS))(contour)
    tree = HairTree(dome(), contour, planted, jnp.zeros(3), (-1, -1, 1))
    tree = jax.tree.map(lambda x: x.astype(jnp.float32), tree)
    uv = sample_roots(tree.scalp, 900, jax.random.key(2))
    owner = np.asarray(find_owner(tree, uv))
    held = np.resize(np.flatnonzero(owner >= 0), CONFIG.strands)
    samples = Samples(uv[held].astype(jnp.float32), jnp.asarray(owner[held]))
    grown = grow_strands(tree, *samples, jnp.ones(len(held), jnp.float32), 12)
    taken = photograph(np.asarray(grown, float), ring(3), ball(), radius_px=1.5)
    hull = hull_where(
        lambda p: np.linalg.norm(p, axis=1) > RADIUS, [-0.2] * 3, [0.2] * 3, 0.02
    )
    nothing = np.zeros(hull.grid.shape)
    volume = hair_volume(hull, Field(np.zeros((*nothing.shape, 3)), nothing))
    shapes = Shapes(3, (HEIGHT, WIDTH), hull.grid.shape, 5, KNOTS)
    compile_refinement(shapes, CONFIG)
    before = programs(descend, move)
    refine(
        tree,
        samples,
        Photographs(
            taken.views,
            taken.depths,
            photo_maps(taken.views, taken.maps, taken.depths),
        ),
        volume,
        np.asarray(grown, float).reshape(-1, 3),
        CONFIG,
        room=5,
    )
    assert programs(descend, move) == before
