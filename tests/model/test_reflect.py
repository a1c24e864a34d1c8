import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from hairfit.model import HairTree, Scalp, ScalpMaps, Wisps, grow_strands
from hairfit.model.edit import Plane
from hairfit.model.reflect import mirror, mirror_cluster

CIRCLES = [(0.3, 0.5, 0.2), (0.7, 0.6, 0.2), (0.28, 0.52, 0.1), (0.72, 0.62, 0.1)]
PARENT = (-1, -1, 0, 1)
KNOTS = 6
X = Plane((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))
Z = Plane((0.0, 0.0, 0.0), (0.0, 0.0, 2.0))
UV = jnp.array([[0.25, 0.5], [0.3, 0.55], [0.7, 0.58], [0.76, 0.65]])
OWNER, ETA = jnp.array([2, 2, 3, 3]), jnp.array([1.0, 0.8, 1.0, 0.9])


@pytest.fixture
def tree(dome, make_tree) -> HairTree:
    """Return curly hair with twists, shear, odd contours, wisps and painted maps."""
    rng = np.random.default_rng(4)
    made = make_tree(dome, CIRCLES, PARENT, knots=KNOTS, seed=3)
    made = eqx.tree_at(
        lambda t: (t.cylinder.shear, t.cylinder.scale, t.cylinder.offset),
        made,
        (
            jnp.asarray(0.2 * rng.normal(size=(4, KNOTS))),
            jnp.asarray(1.0 + 0.2 * rng.normal(size=(4, KNOTS, 2))),
            jnp.asarray(0.002 * rng.normal(size=(4, KNOTS, 32))),
        ),
    )
    shape = jnp.asarray(0.02 * rng.normal(size=(4, 32)))
    made = eqx.tree_at(lambda t: t.contour.offset, made, shape)
    offset = jnp.asarray(0.003 * rng.normal(size=(4, KNOTS, 3)))
    image = jnp.asarray(rng.uniform(size=(5, 7)))
    maps = ScalpMaps(image, image, image, jnp.tile(image[..., None], 3), image)
    return dataclasses.replace(made, wisps=Wisps(UV, OWNER, offset), maps=maps)


def mirrored_uv(uv, plane):
    """Return roots on the other side: x runs with v on the dome, or z against it."""
    flip = jnp.array([-1.0, 1.0]) if plane is X else jnp.array([1.0, -1.0])
    return jnp.array([0.5, 0.5])[None] + flip[None] * (uv - 0.5)


def reflect(points, plane):
    flip = jnp.array([-1.0, 1, 1]) if plane is X else jnp.array([1.0, 1, -1])
    return points * flip[None, None]


@pytest.mark.parametrize("plane", [X, Z])
def test_strands_are_mirror_images(tree, plane):
    image = mirror(tree, plane)
    strands = grow_strands(tree, UV, OWNER, ETA, 12)
    got = grow_strands(image, mirrored_uv(UV, plane), OWNER, ETA, 12)
    assert jnp.max(jnp.abs(got - reflect(strands, plane))) < 1e-9


def test_the_mirror_image_of_the_mirror_image_is_the_hair_itself(tree):
    again = mirror(mirror(tree))
    for name in ("skeleton", "normal", "radius", "offset", "scale", "shear"):
        got, want = (getattr(t.cylinder, name) for t in (again, tree))
        assert jnp.allclose(got, want, atol=1e-9)
    turns = (again.cylinder.twist - tree.cylinder.twist) / (2 * np.pi)
    assert jnp.allclose(turns, jnp.round(turns), atol=1e-9)
    for name in ("centre", "radius", "offset"):
        got, want = (getattr(t.contour, name) for t in (again, tree))
        assert jnp.allclose(got, want, atol=1e-9)
    wisps, maps = tree.wisps, tree.maps
    assert wisps is not None and again.wisps is not None
    assert maps is not None and again.maps is not None
    assert jnp.allclose(again.wisps.offset, wisps.offset, atol=1e-9)
    assert jnp.allclose(again.maps.density, maps.density, atol=1e-6)


def test_painted_maps_are_mirrored(tree):
    image, maps = mirror(tree).maps, tree.maps
    assert image is not None and maps is not None
    assert jnp.allclose(image.density, maps.density[::-1], atol=1e-6)
    assert jnp.allclose(image.colour, maps.colour[::-1], atol=1e-6)


def test_a_sub_tree_appears_on_the_other_side(tree):
    both = mirror_cluster(tree, 0)
    assert both.parent == (-1, -1, 0, 1, -1, 4)
    strands = grow_strands(tree, UV[:2], OWNER[:2], ETA[:2], 12)
    got = grow_strands(both, mirrored_uv(UV[:2], X), jnp.array([5, 5]), ETA[:2], 12)
    assert jnp.max(jnp.abs(got - reflect(strands, X))) < 1e-9
    assert jnp.array_equal(both.cylinder.skeleton[:4], tree.cylinder.skeleton)
    assert both.wisps is not None
    assert both.wisps.owner.tolist() == [2, 2, 3, 3, 5, 5]
    assert eqx.tree_equal(both.maps, tree.maps)
    below = mirror_cluster(tree, 2, parent=1)
    assert below.parent == (-1, -1, 0, 1, 1)
    bald = mirror_cluster(dataclasses.replace(tree, wisps=None), 2)
    assert bald.parent == (-1, -1, 0, 1, 0)
    assert bald.wisps is None
    with pytest.raises(ValueError, match="no cluster 7"):
        mirror_cluster(tree, 7)


def test_hair_on_a_lopsided_scalp_is_rooted_on_it(tree):
    stretch = jnp.diag(jnp.array([1.0, 1.0, 1.3])) + 0.2 * jnp.eye(3)[:, ::-1]
    lopsided = eqx.tree_at(
        lambda t: t.scalp, tree, Scalp(tree.scalp.control @ stretch.T)
    )
    image = mirror(lopsided)
    assert jnp.all(jnp.isfinite(image.cylinder.offset))
    assert jnp.all((image.contour.centre >= 0.0) & (image.contour.centre <= 1.0))
    assert jnp.all(image.contour.radius > 0.0)
