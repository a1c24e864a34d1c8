"""Scattering functions as tables, and the looks made of them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hairfit.render.chiang import chiang, hair_fibre
from hairfit.render.phase import PhaseAngles
from hairfit.render.phase_table import PhaseTable, phase_table, scattered_back
from hairfit.render.pigment import PIGMENTS, chiang_look, colour_of
from hairfit.render.studio import sky_lights


def even(angles):
    # Light goes to all sides wholly and evenly: the integral of cos^2 f is 1.
    return jnp.full(3, 0.25 / np.pi) / jnp.cos(angles.theta_eye)


def test_a_table_holds_the_function_at_the_middles_of_its_steps():
    fibre = hair_fibre(1.3, 0.2)
    table = phase_table(jax.jit(lambda angles: chiang(angles, fibre)), 8, 6)
    theta = (np.arange(8) + 0.5) / 8 * np.pi - np.pi / 2
    phi = (np.arange(6) + 0.5) / 6 * np.pi
    for e, k, a in ((0, 5, 2), (7, 1, 0), (3, 3, 5)):
        angles = PhaseAngles(*(jnp.asarray(x) for x in (theta[k], theta[e], phi[a])))
        expected = np.pi * np.cos(theta[k]) * np.asarray(chiang(angles, fibre))
        np.testing.assert_allclose(table.values[e, k, a], expected, rtol=1e-4)


def test_what_goes_on_and_what_comes_back_are_all_light_of_a_clear_fibre():
    table = phase_table(even, 64, 16)
    np.testing.assert_allclose(table.forward, 0.5, rtol=5e-3)
    np.testing.assert_allclose(table.backward, 0.5, rtol=5e-3)
    clear = hair_fibre(0.0, 0.0)
    table = phase_table(jax.jit(lambda angles: chiang(angles, clear)), 40, 24)
    np.testing.assert_allclose(table.forward + table.backward, 1.0, atol=0.05)
    assert (table.forward > table.backward).all()


def test_light_that_turns_once_or_thrice_is_the_sum_of_all_its_ways():
    on, back = 0.6, 0.1
    values = np.zeros((1, 1, 1, 3), np.float32)
    table = PhaseTable(values, np.full(3, on), np.full(3, back))
    # Through i hairs, back at the next, through the i hairs again.
    once = sum(on**i * back * on**i for i in range(1, 200))
    # Back at hair i, then at any nearer one, then at any further one, and out again.
    found = scattered_back(table)
    assert found[0] > once
    thrice = found[0] - once
    assert thrice == pytest.approx(back**3 * on**2 / (1.0 - on**2) ** 3)


def test_pigments_make_hair_darker_and_redder():
    shades = {name: colour_of(hair_fibre(*held)) for name, held in PIGMENTS.items()}
    order = ["white", "grey", "blonde", "brown", "black"]
    brightness = [sum(shades[name]) for name in order]
    assert brightness == sorted(brightness, reverse=True)
    red, green, blue = shades["red"]
    assert red > 2.5 * green > 2.5 * blue
    np.testing.assert_allclose(shades["white"], 1.0, atol=1e-6)


def test_chiangs_look_lets_red_light_through_brown_hair():
    look = chiang_look(PIGMENTS["brown"], steps=24)
    assert look.forward[0] > look.forward[1] > look.forward[2] > 0.0
    assert look.table is not None


def test_lights_of_a_sky_light_a_surface_as_the_sky_does():
    lights = sky_lights((0.2, 0.3, 0.4), 200)
    for normal in np.eye(3):
        total = sum(
            max(float(light.to_light @ normal), 0.0) * np.asarray(light.colour)
            for light in lights
        )
        np.testing.assert_allclose(total, [0.2, 0.3, 0.4], rtol=0.02)
