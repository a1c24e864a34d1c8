import numpy as np

from hairfit.capture.orientation import OrientationMap
from hairfit.report.pictures import (
    angle_colour,
    exposed,
    hair_window,
    hexadecimal,
    orientation_picture,
)


def test_a_line_has_one_colour_whichever_way_it_is_read():
    angle = np.array([[0.0, np.pi / 3, np.pi / 2]])
    assert np.allclose(angle_colour(angle), angle_colour(angle + np.pi))
    assert np.allclose(angle_colour(angle)[0, 0], [1.0, 0.25, 0.25])


def test_lines_across_each_other_have_opposite_colours():
    angle = np.linspace(0, 3, 7)[None]
    both = angle_colour(angle) + angle_colour(angle + np.pi / 2)
    assert np.allclose(both, 1.0)


def test_what_is_not_hair_or_not_known_is_black():
    one = np.ones((1, 3))
    found = OrientationMap(one, np.array([[1.0, 0.0, 1.0]]), one)
    picture = orientation_picture(found, np.array([[True, True, False]]))
    assert picture[0, 0].any() and not picture[0, 1:].any()


def test_colours_are_written_as_screens_have_them():
    assert hexadecimal(np.array([0.0, 1.0, 0.5])) == "#00ffbc"
    assert hexadecimal(np.array([2.0, -1.0, 0.21404])) == "#ff007f"


def test_an_exposure_multiplies_light():
    picture = np.array([[[10, 127, 250]]], np.uint8)
    assert np.array_equal(exposed(picture, 1.0), picture)
    # Half of the light that sRGB 188 stands for is that of 137.
    assert exposed(np.full((1, 1, 3), 188, np.uint8), 0.5)[0, 0, 0] == 137
    assert exposed(picture, 4.0)[0, 0, 2] == 255


def test_the_window_holds_the_hair_and_stays_in_the_picture():
    hair = np.zeros((100, 80), bool)
    hair[2:40, 30:50] = True
    rows, columns = hair_window(hair)
    assert (rows, columns) == (slice(0, 52), slice(22, 58))
    assert hair_window(np.zeros((9, 7), bool)) == (slice(0, 9), slice(0, 7))
