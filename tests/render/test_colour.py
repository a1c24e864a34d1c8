import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jax.test_util import check_grads

from hairfit.render.colour import attenuate, from_oklab, oklab, tone

lab, back, shade = jax.jit(oklab), jax.jit(from_oklab), jax.jit(attenuate)
part = st.floats(0.0, 1.0)
BLOND = jnp.array([0.55, 0.36, 0.14])


@pytest.mark.parametrize(
    ("rgb", "expected"),
    [
        ((1.0, 1.0, 1.0), (1.0, 0.0, 0.0)),
        ((1.0, 0.0, 0.0), (0.627955, 0.224863, 0.125846)),
        ((0.0, 0.0, 1.0), (0.452014, -0.032457, -0.311528)),
    ],
)
def test_known_colours_are_where_oklab_has_them(rgb, expected):
    assert np.allclose(lab(jnp.asarray(rgb)), expected, atol=2e-3)


@settings(max_examples=50, deadline=None)
@given(st.tuples(part, part, part))
def test_oklab_goes_there_and_back(rgb):
    assert np.allclose(back(lab(jnp.asarray(rgb))), rgb, atol=1e-6)


@settings(max_examples=50, deadline=None)
@given(st.tuples(part, part, part), part, part)
def test_shadow_stays_a_colour_that_can_be_shown(rgb, share, keep):
    found = np.asarray(shade(jnp.asarray(rgb), share, keep))
    assert np.isfinite(found).all() and (found >= -1e-7).all()


def test_nothing_kept_is_scaled_light():
    for share in (0.0, 0.1, 0.6, 1.0):
        assert np.allclose(shade(BLOND, share, 0.0), share * BLOND, atol=1e-7)


def test_full_light_changes_nothing():
    assert np.allclose(shade(BLOND, 1.0, 0.8), BLOND, atol=1e-7)


def test_blond_in_shadow_keeps_its_hue_and_more_chroma_than_when_scaled():
    share = 0.2
    bright, scaled = lab(BLOND), lab(share * BLOND)
    found = lab(shade(BLOND, share, 0.5))
    assert np.isclose(found[0], scaled[0], rtol=1e-3)
    hue = [np.arctan2(x[2], x[1]) for x in (bright, found)]
    assert np.isclose(*hue, atol=0.01)
    chroma = [np.hypot(x[1], x[2]) for x in (scaled, found, bright)]
    assert chroma[0] < chroma[1] < chroma[2]
    assert np.isclose(chroma[1] / chroma[0], share ** (-0.5 / 3), rtol=1e-3)


def test_the_tone_curve_has_white_where_it_was_asked_for():
    grey = jnp.ones(3)
    assert np.allclose(tone(0.0 * grey), 0.0)
    assert np.allclose(tone(4.0 * grey), 1.0, atol=1e-6)
    assert np.allclose(tone(1e-4 * grey), 1e-4, rtol=1e-3)
    light = tone(jnp.linspace(0.0, 4.0, 50)[:, None] * grey[None])[:, 0]
    assert (np.diff(light) > 0.0).all()


def test_tone_keeps_the_ratios_of_colours():
    found = np.asarray(tone(3.0 * BLOND))
    assert np.allclose(found / found[0], BLOND / BLOND[0])


def test_gradients_are_right_and_finite_in_the_dark():
    check_grads(
        shade, (BLOND, jnp.asarray(0.3), jnp.asarray(0.5)), order=1, modes=["rev"]
    )
    slope = jax.jacrev(attenuate, (0, 1))(jnp.zeros(3), 0.0)
    assert all(bool(jnp.isfinite(leaf).all()) for leaf in slope)
