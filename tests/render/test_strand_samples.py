"""Samples of strands in a view."""

import jax.numpy as jnp
import numpy as np
import pytest

from hairfit.render import Camera
from hairfit.render.splat import Grid
from hairfit.render.strand_samples import (
    DepthRange,
    Samples,
    depths_of,
    middles,
    place_in,
    sample_segments,
    samples_needed,
    see_segments,
)
from hairfit.render.view import camera_view

K = jnp.array([[100.0, 0.0, 20.0], [0.0, 100.0, 10.0], [0.0, 0.0, 1.0]])
VIEW = camera_view(Camera(K, jnp.eye(4), 40, 20))


def test_samples_are_the_middles_of_equal_parts_of_the_picture():
    points = jnp.array([[[-0.1, 0.0, 1.0], [0.1, 0.0, 1.0]]])
    segments = see_segments(points, jnp.asarray(0.01), VIEW)
    samples = [sample_segments(segments, s, 4) for s in middles(4, points.dtype)]
    np.testing.assert_allclose(
        np.concatenate([s.pixel[0] for s in samples]), [12.5, 17.5, 22.5, 27.5]
    )
    # 20 pixels long and 1 wide.
    np.testing.assert_allclose(np.concatenate([s.area for s in samples]), 5.0)


def test_a_segment_that_reaches_behind_the_eye_covers_nothing():
    points = jnp.array([[[0.0, 0.0, 1.0], [0.1, 0.0, 1.0], [0.1, 0.0, -1.0]]])
    segments = see_segments(points, jnp.asarray(0.01), VIEW)
    np.testing.assert_allclose(segments.length, [10.0, 0.0], atol=1e-12)


def test_only_segments_in_the_picture_count_for_the_number_of_samples():
    seen = jnp.array([[[0.0, 0.0, 1.0], [0.0, 0.03, 1.0]]])
    beside = jnp.array([[[5.0, 0.0, 1.0], [9.0, 0.0, 1.0]]])
    behind = jnp.array([[[5.0, 0.0, -1.0], [9.0, 0.0, -1.0]]])
    assert samples_needed(jnp.concatenate([seen, beside, behind]), VIEW) == 3
    assert samples_needed(behind, VIEW) == 1


def test_the_outermost_layers_centres_are_the_outermost_depths():
    depth = jnp.array([0.7, 0.8, 1.1])
    between = depths_of(depth, 5)
    samples = Samples(jnp.full((2, 3), 0.5), depth, jnp.ones(3), jnp.ones(3))
    place = place_in(samples, between, Grid(20, 40, 5))
    np.testing.assert_allclose(place.layer, [0.0, 1.0, 4.0], atol=1e-12)
    np.testing.assert_allclose(place.column, 0.0)


@pytest.mark.parametrize("depth", [0.1, 5.0])
def test_what_lies_beyond_the_range_is_in_the_outermost_layer(depth):
    between = DepthRange(jnp.asarray(1.0), jnp.asarray(2.0))
    samples = Samples(
        jnp.full((2, 1), 0.5), jnp.array([depth]), jnp.ones(1), jnp.ones(1)
    )
    place = place_in(samples, between, Grid(20, 40, 5))
    assert float(place.layer[0]) == (0.0 if depth < 1.0 else 4.0)
