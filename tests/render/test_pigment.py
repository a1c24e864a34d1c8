"""Absorption of hair from a colour, and the looks made of fibres."""

import numpy as np
import pytest

from hairfit.render.marschner import marschner
from hairfit.render.pigment import (
    PIGMENTS,
    colour_of,
    fibre_look,
    fibre_of_colour,
    fibre_of_name,
    fibre_of_pigment,
)


@pytest.mark.parametrize("azimuthal", [0.2, 0.35, 0.9])
def test_a_fibre_of_a_colour_has_that_colour(azimuthal):
    colour = (0.4, 0.02, 0.7)
    found = colour_of(fibre_of_colour(colour, azimuthal))
    np.testing.assert_allclose(found, colour, rtol=1e-5)


def test_black_and_white_have_fibres():
    for shade in (0.0, 1.0):
        found = colour_of(fibre_of_colour((shade, shade, shade)))
        np.testing.assert_allclose(found, shade, atol=0.003)


def test_every_name_has_a_fibre_as_dark_as_its_shade():
    names = ["black", "brown", "grey", "blonde", "white"]
    seen = [sum(colour_of(fibre_of_name(name))) for name in names]
    assert seen == sorted(seen)
    grey = np.array(colour_of(fibre_of_name("grey")))
    assert np.ptp(grey) < 0.1 * grey.mean()
    red, green, blue = colour_of(fibre_of_name("red"))
    assert red > 3.0 * green > 3.0 * blue


def test_marschners_model_makes_a_look_too():
    look = fibre_look(
        fibre_of_pigment(PIGMENTS["red"]), marschner, steps=16, width=1e-4
    )
    assert look.table is not None and look.width == 1e-4
    assert look.forward[0] > look.forward[2] > 0.0
