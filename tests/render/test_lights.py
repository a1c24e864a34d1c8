"""Lights, shadows in hair that they light, and gradients of both."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads

from hairfit.render import Fibre
from hairfit.render.lights import (
    DistantLight,
    PointLight,
    ShadowConfig,
    ball_around,
    knot_tangents,
    shade,
)
from hairfit.render.opacity_volume import OpacityConfig

WHITE = jnp.ones(3)
FIBRE = Fibre(
    jnp.array([0.01, 0.02, 0.03]),
    jnp.array([0.3, 0.2, 0.1]),
    jnp.array([0.5, 0.5, 0.5]),
    jnp.asarray(20.0),
)
EYE = jnp.array([0.1, 0.2, 1.0])
CONFIG = ShadowConfig(size=24, opacity=OpacityConfig(slabs=8, samples=2))
LIGHTS = [
    DistantLight(jnp.array([0.3, 1.0, 0.4]), jnp.array([1.0, 0.9, 0.8])),
    PointLight(jnp.array([0.2, 0.4, 0.3]), jnp.array([0.1, 0.1, 0.2])),
]
SHADE = jax.jit(shade, static_argnames="config")


def make_strands(strands=20, knots=5, seed=0):
    rng = np.random.default_rng(seed)
    root = rng.uniform(-0.05, 0.05, (strands, 1, 3))
    way = rng.normal(0.0, 0.01, (strands, knots, 3))
    return jnp.asarray(root + np.cumsum(way, axis=1))


def lit(points, eye, fibre, lights, width=2e-3):
    width = jnp.asarray(width, points.dtype)
    return SHADE(points, width, eye, fibre, lights, ambient=WHITE, config=CONFIG)


@pytest.mark.parametrize("light", LIGHTS)
def test_a_lights_picture_holds_all_points(light):
    points = make_strands()
    view, between = light.view(points, 24)
    seen = jax.vmap(view.see)(points.reshape(-1, 3))
    assert float(seen.pixel.min()) >= 2.0 - 1e-9
    assert float(seen.pixel.max()) <= 22.0 + 1e-9
    assert float(seen.depth.min()) >= float(between.near)
    assert float(seen.depth.max()) <= float(between.far)


@pytest.mark.parametrize("light", LIGHTS)
def test_a_lights_depth_grows_away_from_it(light):
    points = make_strands()
    view, _ = light.view(points, 24)
    p = points[0, 0]
    nearer = p + 0.01 * light.arriving(p).to_light
    assert float(view.see(nearer).depth) < float(view.see(p).depth)
    np.testing.assert_allclose(view.see(nearer).pixel, view.see(p).pixel, atol=1e-9)


def test_the_ball_holds_all_points():
    points = make_strands()
    ball = ball_around(points)
    apart = jnp.linalg.norm(points.reshape(-1, 3) - ball.centre[None], axis=1)
    assert float(apart.max()) == pytest.approx(float(ball.radius))


def test_a_lamps_light_falls_with_the_square_of_the_distance():
    lamp = PointLight(jnp.array([0.0, 1.0, 0.0]), jnp.array([1.0, 2.0, 3.0]))
    at_one, at_two = (lamp.arriving(jnp.array([0.0, y, 0.0])) for y in (0.0, -1.0))
    np.testing.assert_allclose(at_one.radiance, lamp.intensity)
    np.testing.assert_allclose(at_two.radiance, lamp.intensity / 4.0)
    np.testing.assert_allclose(at_one.to_light, [0.0, 1.0, 0.0])


def test_without_shadow_light_is_that_of_the_closed_form():
    strand = jnp.stack([jnp.linspace(-0.02, 0.02, 4), *jnp.zeros((2, 4))], -1)[None]
    light = DistantLight(jnp.array([0.0, 0.0, 2.0]), jnp.array([1.0, 0.5, 0.25]))
    eye = jnp.array([0.0, 0.0, 1e6])
    found = lit(strand, eye, FIBRE, [light], width=1e-12)
    expected = FIBRE.ambient + (FIBRE.diffuse + FIBRE.specular) * light.colour
    np.testing.assert_allclose(found, np.broadcast_to(expected, (1, 4, 3)), rtol=1e-6)


def test_hair_behind_hair_is_dark_and_keeps_its_ambient_light():
    rows = jnp.linspace(-0.05, 0.05, 200)
    sheet = jnp.stack(
        [
            jnp.broadcast_to(jnp.linspace(-0.05, 0.05, 9)[None], (200, 9)),
            jnp.broadcast_to(rows[:, None], (200, 9)),
            jnp.zeros((200, 9)),
        ],
        -1,
    )
    behind = sheet.at[..., 2].set(-0.06)
    light = DistantLight(jnp.array([0.0, 0.0, 1.0]), WHITE)
    found = lit(jnp.concatenate([sheet, behind]), EYE, FIBRE, [light], width=1e-2)
    front, back = found[60:140, 3:6], found[260:340, 3:6]
    # Two sheets, each 20 times as much as covers it: the back one sees no light.
    np.testing.assert_allclose(
        back, np.broadcast_to(FIBRE.ambient, back.shape), atol=1e-4
    )
    assert float(front.mean()) > float(back.mean())


def test_light_of_several_lamps_adds_up():
    points = make_strands()
    dark = lit(points, EYE, FIBRE, [])
    both = lit(points, EYE, FIBRE, LIGHTS)
    each = [lit(points, EYE, FIBRE, [light]) - dark for light in LIGHTS]
    np.testing.assert_allclose(both - dark, each[0] + each[1], atol=1e-12)


def test_gradients_are_those_of_finite_differences():
    points = make_strands()
    weight = jnp.asarray(np.random.default_rng(2).normal(size=points.shape))

    def loss(points, fibre, lights, eye):
        tree = jax.tree.map(jnp.asarray, (points, eye, fibre, lights))
        return jnp.sum(weight * lit(*tree))

    # The rim of the hair sets the lights' pictures, which has no gradient: keep still.
    apart = jnp.linalg.norm(points - ball_around(points).centre[None, None], axis=-1)
    inner = jnp.where((apart < 0.05)[..., None], 1.0, 0.0)

    def moved(move, fibre, lights, eye):
        return loss(points + inner * move, fibre, lights, eye)

    arguments = (jnp.zeros_like(points), FIBRE, LIGHTS, EYE)
    check_grads(moved, arguments, order=1, modes=["rev"], eps=1e-7, rtol=1e-3)


@pytest.mark.parametrize("position", [[0.0, 0.0, 0.0], [0.01, 0.0, 0.02]])
def test_a_lamp_within_the_hair_gives_finite_light_and_gradients(position):
    points = make_strands().at[0, 0].set(jnp.array(position))
    points = points.at[1].set(points[1, :1])  # a strand of no length
    lamp = PointLight(jnp.array(position), WHITE)

    def total(points, lamp):
        return lit(points, points[2, 2], FIBRE, [lamp]).sum()

    value, slopes = eqx.filter_value_and_grad(lambda x: total(*x))((points, lamp))
    assert jnp.isfinite(value)
    assert all(jnp.isfinite(x).all() for x in jax.tree.leaves(slopes))


def test_tangents_are_of_length_1_or_0():
    points = make_strands().at[1].set(0.0)
    length = jnp.linalg.norm(knot_tangents(points), axis=-1)
    np.testing.assert_allclose(length.at[1].set(1.0), 1.0)
    assert not length[1].any()
