import jax
import jax.numpy as jnp
import numpy as np
import pytest
from ball_hair import RADIUS, ball, comb, meridian

from hairfit.capture.distance import signed_distance
from hairfit.errors import InputError
from hairfit.fit.root_scalp import root_places, scalp_for
from hairfit.model import scalp_point
from hairfit.types import Strands


def roots_on(polar, count=800, seed=0):
    """Roots all over a cap of the ball."""
    rng = np.random.default_rng(seed)
    level = np.arccos(rng.uniform(np.cos(polar), 1.0, count))
    return meridian(level, rng.uniform(-np.pi, np.pi, count))


def missed(scalp, roots):
    on = jax.vmap(scalp_point, (None, 0))(scalp, jnp.asarray(root_places(scalp, roots)))
    return np.linalg.norm(np.asarray(on) - roots, axis=1)


@pytest.mark.parametrize("polar", [0.4, 1.2, 2.0])
@pytest.mark.parametrize("head", [ball(), None])
def test_the_patch_covers_all_roots(head, polar):
    roots = roots_on(polar)
    scalp = scalp_for(head, Strands.from_array(comb(roots)))
    assert missed(scalp, roots).max() < 0.001
    inner = root_places(scalp, roots)
    assert (inner > 0.0).all() and (inner < 1.0).all()


def test_where_no_root_is_the_patch_lies_on_the_skin():
    roots = roots_on(1.4)
    roots = roots[roots[:, 0] > 0.0]
    scalp = scalp_for(ball(), Strands.from_array(comb(roots)))
    side = jnp.linspace(0.1, 0.9, 20)
    uv = jnp.stack(jnp.meshgrid(side, side), axis=-1).reshape(-1, 2)
    on = np.asarray(jax.vmap(scalp_point, (None, 0))(scalp, uv))
    assert np.abs(signed_distance(ball(), on)).max() < 0.003


def test_roots_on_a_band_off_the_skin_are_on_the_patch_as_well():
    crown = roots_on(1.2)
    turn = np.linspace(-np.pi, np.pi, 200, endpoint=False)
    ring = meridian(0.25, turn, np.full(200, 0.01))
    roots = np.concatenate([crown[np.hypot(crown[:, 0], crown[:, 2]) > 0.04], ring])
    strands = comb(roots)
    strands += (roots - strands[:, 0])[:, None]
    scalp = scalp_for(ball(), Strands.from_array(strands))
    assert np.median(missed(scalp, roots)[-200:]) < 0.003


def test_the_patch_follows_a_head_that_is_moved():
    shift = np.array([0.3, 1.5, -0.2])
    roots = roots_on(1.0)
    here = scalp_for(ball(), Strands.from_array(comb(roots)))
    there = scalp_for(ball(centre=shift), Strands.from_array(comb(roots) + shift))
    apart = np.asarray(there.control) - np.asarray(here.control) - shift
    assert np.abs(apart).max() < 5e-4


def test_one_strand_has_a_patch():
    roots = meridian(np.array([0.3]), np.array([0.0]))
    scalp = scalp_for(None, Strands.from_array(comb(roots)))
    assert missed(scalp, roots)[0] < 0.001


def test_hair_in_centimetres_is_refused_with_both_sizes():
    roots = roots_on(1.0)
    with pytest.raises(InputError, match="from the head in the median"):
        scalp_for(ball(), Strands.from_array(5.0 * comb(roots)))
    assert 5.0 * RADIUS < 1.0
