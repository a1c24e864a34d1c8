import numpy as np
import pytest

from hairfit.types import resample_paths


@pytest.mark.parametrize("kept", [1.0, 0.3])
def test_polylines_are_resampled_as_interpolation_along_them(kept):
    rng = np.random.default_rng(4)
    paths = rng.normal(size=(20, 30, 3)).cumsum(axis=1)
    paths[3, 7:] = paths[3, 7]  # a strand that ended
    paths[5, 10:13] = paths[5, 10]  # one that stood still for a while
    found = resample_paths(paths, 17, kept)
    for path, points in zip(paths, found, strict=True):
        steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
        along = np.concatenate([[0.0], np.cumsum(steps)])
        at = np.linspace(0.0, kept * along[-1], 17)
        expected = [np.interp(at, along, path[:, k]) for k in range(3)]
        assert np.allclose(points, np.stack(expected, axis=1), atol=1e-9)


def test_a_strand_that_did_not_grow_stays_at_its_root():
    paths = np.broadcast_to(np.array([1.0, 2.0, 3.0]), (2, 6, 3))
    assert np.allclose(resample_paths(paths, 4), [1.0, 2.0, 3.0], atol=1e-12)


def test_no_strands_are_no_error():
    assert resample_paths(np.zeros((0, 5, 3)), 4).shape == (0, 4, 3)
