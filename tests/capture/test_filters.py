import numpy as np
import pytest

from hairfit.capture.filters import line_moments, square_means


def test_pixels_are_reduced_to_their_means():
    values = np.random.default_rng(0).normal(size=(7, 9, 2))
    found = square_means(values, 3)
    assert found.shape == (3, 3, 2)
    assert np.allclose(found[1, 2], values[3:6, 6:9].mean(axis=(0, 1)), atol=1e-6)
    assert np.allclose(found[2, 0], values[6:7, :3].sum(axis=(0, 1)) / 9, atol=1e-6)


@pytest.mark.parametrize("wavelength", [4.2, 8.5, 12.0, 17.0])
def test_a_quarter_turn_of_the_picture_turns_the_moments(wavelength):
    # Bands that take every other sample only stand on the same grid as the others.
    values = np.random.default_rng(0).normal(size=(64, 64)).astype(np.float32)
    found = line_moments(values, wavelength, 3.5, 0.55)
    turned = line_moments(np.ascontiguousarray(np.rot90(values)), wavelength, 3.5, 0.55)
    inner = slice(8, -8), slice(8, -8)
    expected = np.rot90(found) * np.array([-1.0, -1.0, 1.0], np.float32)
    off = np.abs(turned - expected)[inner].max() / found[..., 2].max()
    assert off < 0.05
