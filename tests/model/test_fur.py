import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads

from hairfit.model.curve import arc_length
from hairfit.model.fur import (
    curl_pitch,
    curl_strands,
    fur_arcs,
    fur_style,
    grow_fur,
)
from hairfit.model.maps import even_maps, sample_map
from hairfit.model.scalp import scalp_normal, scalp_point

lengths_of = jax.jit(jax.vmap(lambda strand: arc_length(strand)[-1]))


def straight(points=201, length=0.2, count=1):
    """Strands along +y."""
    y = jnp.linspace(0.0, length, points)
    strand = y[:, None] * jnp.array([[0.0, 1.0, 0.0]])
    return jnp.tile(strand[None], (count, 1, 1))


def numbers(*values):
    return jnp.asarray(values, float)


def test_a_curled_strand_is_a_helix_about_what_it_was():
    strand = straight()
    curled = curl_strands(strand, numbers(0.01), numbers(0.05), numbers(0.3))[0]
    y = np.asarray(strand[0, :, 1])
    beyond = y >= 0.05  # after the first turn
    across = np.asarray(curled)[:, [0, 2]]
    assert np.allclose(np.asarray(curled)[:, 1], y, atol=1e-12)
    assert np.allclose(np.hypot(*across[beyond].T), 0.01, atol=1e-12)
    angle = np.unwrap(np.arctan2(across[1:, 1], across[1:, 0]))
    rate = np.abs(np.diff(angle)) / np.diff(y[1:])
    assert np.allclose(rate, 2 * np.pi / 0.05, rtol=1e-6)


def test_curls_do_not_move_roots():
    strand = straight(21)
    curled = curl_strands(strand, numbers(0.01), numbers(0.02), numbers(1.0))
    assert jnp.array_equal(curled[:, 0], strand[:, 0])


def test_a_curl_without_radius_leaves_the_strand():
    strands = straight(31, count=2)
    curled = curl_strands(strands, jnp.zeros(2), numbers(0.02, 0.0), numbers(1.0, 2.0))
    assert jnp.allclose(curled, strands, atol=1e-15)


def test_strands_that_share_a_phase_curl_together():
    apart = jnp.array([0.1, 0.0, 0.0])
    pair = jnp.concatenate([straight(41), straight(41) + apart[None, None]])
    curled = curl_strands(pair, jnp.full(2, 0.01), jnp.full(2, 0.05), jnp.full(2, 0.7))
    assert jnp.allclose(curled[1] - curled[0], apart[None], atol=1e-12)


def test_curls_keep_their_slope():
    radius = numbers(0.001, 0.01, 0.03)
    slope = 2.0 * jnp.pi * radius / curl_pitch(radius)
    assert jnp.allclose(slope, slope[0], rtol=1e-12) and 0.8 < slope[0] < 1.2
    assert curl_pitch(jnp.zeros(1))[0] > 0.0


def test_gradients_of_curls():
    strand = straight(9) + 0.01 * jnp.asarray(
        np.random.default_rng(0).normal(size=(1, 9, 3))
    )
    arguments = strand, numbers(0.01), numbers(0.13), numbers(0.4)
    check_grads(curl_strands, arguments, order=1, eps=1e-6, modes=["rev"])


def test_gradients_of_curls_are_finite_where_points_coincide():
    def size(strands, radius):
        curled = curl_strands(strands, radius, numbers(0.01), numbers(0.0))
        return jnp.sum(curled**2)

    slope = jax.jit(jax.grad(size, argnums=(0, 1)))(jnp.ones((1, 5, 3)), numbers(0.0))
    assert all(jnp.all(jnp.isfinite(x)) for x in slope)


def arcs(scalp, uv, lean, length, bend, points=9):
    count = len(uv)
    lean = jnp.tile(jnp.asarray(lean, float)[None], (count, 1))
    return fur_arcs(
        scalp, uv, lean, jnp.full(count, length), jnp.zeros((count, 2)), bend, points
    )


def test_fur_that_is_not_combed_stands_upright(dome):
    uv = jnp.asarray(np.random.default_rng(0).uniform(0.1, 0.9, size=(20, 2)))
    strands = arcs(dome, uv, [0.0, 0.0], 0.03, 0.0)
    up = jax.jit(jax.vmap(scalp_normal, (None, 0)))(dome, uv)
    root = jax.jit(jax.vmap(scalp_point, (None, 0)))(dome, uv)
    assert jnp.allclose(strands[:, 0], root, atol=1e-15)
    assert jnp.allclose(strands[:, -1], root + 0.03 * up, atol=1e-12)


def test_fur_leans_as_it_is_combed(flat):
    # Half of the way down, towards v: by 45 degrees; v runs along -z or +z.
    uv = jnp.array([[0.5, 0.5]])
    strand = arcs(flat, uv, [0.0, 0.5], 0.1, 0.0)[0]
    towards = scalp_point(flat, jnp.array([0.5, 0.6])) - scalp_point(flat, uv[0])
    flow = towards / jnp.linalg.norm(towards)
    step = (strand[-1] - strand[0]) / 0.1
    half = np.sqrt(0.5)
    assert jnp.allclose(jnp.dot(step, flow), half, atol=1e-9)
    assert jnp.allclose(jnp.abs(step[1]), half, atol=1e-9)


def test_fur_combed_flat_lies_on_the_skin(flat):
    strand = arcs(flat, jnp.array([[0.5, 0.5]]), [1.0, 0.0], 0.1, 0.0)[0]
    assert jnp.allclose(strand[:, 1], 0.0, atol=1e-12)


def test_bent_fur_is_an_arc_of_a_circle(flat):
    strand = arcs(flat, jnp.array([[0.5, 0.5]]), [0.5, 0.0], 0.1, 0.8, 401)[0]
    assert abs(float(lengths_of(strand[None])[0]) - 0.1) < 1e-6
    step = jnp.diff(strand, axis=0)
    step = step / jnp.linalg.norm(step, axis=1, keepdims=True)
    turned = jnp.arccos(jnp.clip(jnp.dot(step[0], step[-1]), -1.0, 1.0))
    assert abs(float(turned) - 0.8 * 399 / 400) < 1e-3
    between = jnp.sum(step[1:] * step[:-1], axis=1)
    assert jnp.allclose(between, between[0], atol=1e-9)


def test_gradients_of_fur_are_finite_where_it_stands_upright(dome):
    def size(lean, bend):
        uv, zero = jnp.array([[0.4, 0.6]]), jnp.zeros((1, 2))
        return jnp.sum(fur_arcs(dome, uv, lean, numbers(0.03), zero, bend, 5) ** 2)

    slope = jax.jit(jax.grad(size, argnums=(0, 1)))
    for lean in (jnp.zeros((1, 2)), jnp.array([[0.3, 0.1]])):
        for bend in (0.0, 0.5):
            found = slope(lean, jnp.asarray(bend))
            assert all(jnp.all(jnp.isfinite(x)) for x in found)


@pytest.fixture(scope="module")
def ramped():
    """Hair on half of the scalp, twice as long at v = 1 as at v = 0."""
    maps = even_maps(5, 5, curl=0.0)
    half = jnp.tile((jnp.arange(5) > 2)[:, None].astype(float), (1, 5))
    long = jnp.tile(jnp.linspace(0.5, 1.0, 5)[None], (5, 1))
    return eqx.tree_at(lambda m: (m.density, m.length), maps, (half, long))


def test_fur_follows_the_maps_of_density_and_length(dome, ramped):
    style = fur_style(0.02, length_variation=0.0, disorder=0.0)
    fur = grow_fur(dome, ramped, 400, 12, jax.random.key(0), style)
    assert fur.strands.shape == (400, 12, 3)
    assert jnp.all(fur.uv[:, 0] > 0.5)
    share = jax.vmap(sample_map, (None, 0))(ramped.length, fur.uv)
    assert jnp.allclose(lengths_of(fur.strands), 0.02 * share, rtol=5e-3)
    assert jnp.allclose(fur.attributes.length, share)


def test_fur_varies_in_length_and_direction_and_grows_again_from_its_key(dome, ramped):
    style = fur_style(0.02, length_variation=0.5, disorder=0.3)
    fur = grow_fur(dome, ramped, 400, 12, jax.random.key(0), style)
    again = grow_fur(dome, ramped, 400, 12, jax.random.key(0), style)
    assert jnp.array_equal(fur.strands, again.strands)
    ratio = lengths_of(fur.strands) / (0.02 * fur.attributes.length)
    assert jnp.min(ratio) < 0.6 and jnp.max(ratio) > 0.9
    up = jax.jit(jax.vmap(scalp_normal, (None, 0)))(dome, fur.uv)
    step = fur.strands[:, 1] - fur.strands[:, 0]
    step = step / jnp.linalg.norm(step, axis=1, keepdims=True)
    assert 0.2 < jnp.mean(jnp.arccos(jnp.sum(up * step, axis=1))) < 0.6


def test_curls_of_fur_come_from_its_map(dome, ramped):
    style = fur_style(0.02, length_variation=0.0, disorder=0.0)
    curly = eqx.tree_at(lambda m: m.curl, ramped, jnp.full((5, 5), 0.001))
    plain, curled = (
        grow_fur(dome, maps, 400, 12, jax.random.key(0), style).strands
        for maps in (ramped, curly)
    )
    apart = jnp.linalg.norm(curled - plain, axis=-1)
    assert jnp.allclose(apart[:, -1], 0.001, rtol=1e-6)
    assert jnp.all(apart[:, 0] == 0.0)


def test_bald_skin_has_no_fur(dome):
    style = fur_style(0.02)
    fur = grow_fur(dome, even_maps(2, 2, density=0.0), 9, 5, jax.random.key(0), style)
    assert fur.strands.shape == (0, 5, 3)
