import numpy as np

from hairfit.capture.filters import square_means


def test_pixels_are_reduced_to_their_means():
    values = np.random.default_rng(0).normal(size=(7, 9, 2))
    found = square_means(values, 3)
    assert found.shape == (3, 3, 2)
    assert np.allclose(found[1, 2], values[3:6, 6:9].mean(axis=(0, 1)), atol=1e-6)
    assert np.allclose(found[2, 0], values[6:7, :3].sum(axis=(0, 1)) / 9, atol=1e-6)
