import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads

from hairfit import model
from hairfit.model import Scalp, sample_roots

scalp_point, scalp_normal = jax.jit(model.scalp_point), jax.jit(model.scalp_normal)
points_at = jax.jit(jax.vmap(model.scalp_point, (None, 0)))
normals_at = jax.jit(jax.vmap(model.scalp_normal, (None, 0)))
uvs_at = jax.jit(jax.vmap(model.scalp_uv, (None, 0)))
EVERYWHERE = jnp.asarray(np.random.default_rng(0).uniform(size=(200, 2)))


def test_the_patch_runs_through_its_control_points(dome):
    assert jnp.allclose(
        scalp_point(dome, jnp.array([3.0, 7.0]) / 12), dome.control[3, 7], atol=1e-15
    )
    assert jnp.array_equal(scalp_point(dome, jnp.zeros(2)), dome.control[0, 0])


def test_fewer_roots_are_the_first_of_many(dome):
    """All numbers share a program, and no number of roots changes any of them."""
    key = jax.random.key(7)
    many = sample_roots(dome, 40_000, key)
    assert many.shape == (40_000, 2)
    for count in (0, 1, 2500):
        assert jnp.array_equal(sample_roots(dome, count, key), many[:count])


def test_normals_point_outwards_whichever_way_u_and_v_run(dome):
    mirrored = Scalp(dome.control[::-1])
    turned = Scalp(dome.control.transpose(1, 0, 2))
    for scalp in (dome, mirrored, turned):
        radial = points_at(scalp, EVERYWHERE) / 0.09
        away = jnp.sum(radial * normals_at(scalp, EVERYWHERE), axis=1)
        assert jnp.all(away > 0.99)


def test_normals_do_not_flip_in_a_dent(dome):
    dent = dome.control.at[5:8, 5:8].multiply(0.7)
    want = normals_at(dome, EVERYWHERE)
    got = normals_at(Scalp(dent), EVERYWHERE)
    assert jnp.all(jnp.sum(want * got, axis=1) > 0.0)


def test_a_flat_patch_has_the_normal_of_u_and_v(flat):
    assert jnp.allclose(
        normals_at(flat, EVERYWHERE[:5]), jnp.tile(jnp.eye(3)[1:2], (5, 1))
    )


def test_a_pinched_patch_has_normals_and_finite_gradients(dome):
    pinched = Scalp(dome.control.at[0].set(dome.control[0, 6]))
    uv = jnp.array([0.0, 0.5])
    assert jnp.allclose(jnp.linalg.norm(scalp_normal(pinched, uv)), 1.0)
    slope = jax.jit(jax.jacrev(model.scalp_normal))(pinched, uv)
    assert jnp.all(jnp.isfinite(slope.control))


def test_roots_are_even_in_metres_and_not_in_uv():
    # u is squared: half of u covers a quarter of the area.
    side = jnp.linspace(0.0, 1.0, 13)
    x, z = jnp.meshgrid(side**2, side, indexing="ij")
    scalp = Scalp(jnp.stack([x, jnp.zeros_like(x), z], axis=-1))
    uv = sample_roots(scalp, 20_000, jax.random.key(0))
    p = np.asarray(points_at(scalp, uv))
    counts = np.histogram2d(p[:, 0], p[:, 2], bins=4, range=[[0, 1], [0, 1]])[0]
    assert np.abs(counts / 1250 - 1.0).max() < 0.12  # 4 standard deviations
    assert jnp.mean(uv[:, 0] < 0.5) < 0.3


def test_the_same_key_gives_the_same_roots(dome):
    one, same, other = (sample_roots(dome, 9, jax.random.key(k)) for k in (1, 1, 2))
    assert jnp.array_equal(one, same)
    assert not jnp.array_equal(one, other)


def test_points_on_the_scalp_find_themselves(dome):
    uv = uvs_at(dome, points_at(dome, EVERYWHERE))
    assert jnp.allclose(uv, EVERYWHERE, atol=1e-8)


@pytest.mark.parametrize("height", [0.02, -0.02])
def test_points_off_the_scalp_find_a_foot_straight_under_them(dome, height):
    p = points_at(dome, EVERYWHERE) + height * normals_at(dome, EVERYWHERE)
    distance = jnp.linalg.norm(points_at(dome, uvs_at(dome, p)) - p, axis=1)
    assert jnp.all(distance < abs(height) + 2e-6)


def test_points_past_the_border_find_the_closest_point_on_it(flat):
    p = jnp.array([[0.5, 0.3, -0.2], [1.4, 0.0, 0.25], [-0.1, 0.2, 1.3]])
    want = jnp.array([[0.0, 0.5], [0.25, 1.0], [1.0, 0.0]])
    assert jnp.allclose(uvs_at(flat, p), want, atol=1e-9)


def test_a_guess_is_where_the_search_starts(dome):
    near = EVERYWHERE[0] + 0.01
    p = scalp_point(dome, EVERYWHERE[0])
    found = jax.jit(model.scalp_uv)(dome, p, near)
    assert jnp.allclose(found, EVERYWHERE[0], atol=1e-9)


def test_gradients_of_the_scalp(dome):
    uv = jnp.array([0.31, 0.77])
    check_grads(scalp_point, (dome, uv), order=1, eps=1e-6)
    check_grads(scalp_normal, (dome, uv), order=1, eps=1e-6, modes=["rev"])
