"""What a camera measures of hair, and that its gradients are right."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hairfit.render import Camera, Fibre
from hairfit.render.lights import DistantLight, ShadowConfig, shade
from hairfit.render.observe import Appearance, ObserveConfig, observe, seen_share
from hairfit.render.opacity_volume import OpacityConfig
from hairfit.render.strand_samples import DepthRange, samples_needed
from hairfit.render.view import View, camera_view

SIZE = 32
BETWEEN = DepthRange(jnp.asarray(0.7), jnp.asarray(0.9))
CONFIG = ObserveConfig(layers=8, samples=3)
FRONT, BACK = jnp.array([1.0, 0.2, 0.0]), jnp.array([0.0, 0.3, 1.0])


def make_camera(size: int = SIZE) -> Camera:
    """Return a camera 0.8 m before the origin; x and y of the world as in pictures."""
    f, half = 7.0 * size, 0.5 * size
    K = jnp.array([[f, 0.0, half], [0.0, f, half], [0.0, 0.0, 1.0]])
    return Camera(K, jnp.eye(4).at[2, 3].set(0.8), size, size)


def wisp(x, z, strands=40, knots=6, seed=0):
    """Return strands around a place, downwards and bent a little."""
    rng = np.random.default_rng(seed)
    root = rng.uniform([-0.012, -0.04, -0.004], [0.012, -0.03, 0.004], (strands, 3))
    way = rng.normal(0.0, 0.003, (strands, knots, 3)) + [0.0, 0.012, 0.0]
    return root[:, None] + np.cumsum(way, axis=1) + [x, 0.0, z]


def two_wisps():
    """Return a wisp before another one, and their colours."""
    points = np.concatenate([wisp(0.004, -0.06), wisp(-0.004, 0.06, seed=1)])
    colour = jnp.concatenate(
        [jnp.broadcast_to(c, (40, 6, 3)) for c in (FRONT, BACK)], axis=0
    )
    return jnp.asarray(points), Appearance(jnp.asarray(2e-3), colour)


def measures(observation, seed=5):
    """Return a number for each output that follows from all its pixels."""
    rng = np.random.default_rng(seed)
    # Where hardly any hair is, its depth means nothing.
    seen = observation.coverage > 0.02
    depth = jnp.where(seen, observation.depth - 0.8, 0.0)
    return jnp.stack(
        [
            jnp.sum(out * jnp.asarray(rng.normal(size=out.shape), out.dtype) + out**2)
            for out in observation._replace(depth=depth)
        ]
    )


def compare(measure, x, count=200, step=1e-6):
    """Return the least cosine of gradients and central differences at random numbers.

    One for each output: coverage, orientation, depth and colour.
    """
    measure = jax.jit(measure)
    slopes = np.asarray(jax.jacrev(measure)(x)).reshape(4, -1)
    assert np.isfinite(slopes).all()
    flat = np.asarray(x).reshape(-1)
    chosen = np.random.default_rng(3).permutation(flat.size)[:count]
    expected = []
    for i in chosen:
        move = np.zeros(flat.size)
        move[i] = step
        up, down = (
            measure(jnp.asarray((flat + s * move).reshape(x.shape))) for s in (1, -1)
        )
        expected.append(np.asarray(up - down) / (2.0 * step))
    expected = np.array(expected).T
    # Some outputs do not depend on some inputs.
    some = np.linalg.norm(expected, axis=1) > 0.0
    assert not slopes[~some].any()
    product = np.sum(slopes[:, chosen] * expected, axis=1)[some]
    sizes = [np.linalg.norm(a[some], axis=1) for a in (slopes[:, chosen], expected)]
    return np.min(product / np.prod(sizes, axis=0))


@pytest.mark.parametrize("occluded", [False, True])
@pytest.mark.parametrize("blur", [1.0, 0.4])
def test_gradients_by_points_are_those_of_finite_differences(occluded, blur):
    config = dataclasses.replace(CONFIG, blur=blur)
    points, look = two_wisps()
    if not occluded:
        points, look = points[:40], first(look)
    view = camera_view(make_camera())

    def measure(p):
        return measures(observe(p, view, look, between=BETWEEN, config=config))

    assert compare(measure, points) > 0.99


def test_gradients_by_the_camera_are_those_of_finite_differences():
    points, look = two_wisps()
    camera = make_camera()

    def measure(pose):
        view = camera_view(eqx.tree_at(lambda c: c.cam_from_world, camera, pose))
        return measures(observe(points, view, look, between=BETWEEN, config=CONFIG))

    assert compare(measure, camera.cam_from_world, step=1e-7) > 0.99


def test_gradients_beneath_a_head_are_those_of_finite_differences():
    points, look = two_wisps()
    view = camera_view(make_camera())
    config = ObserveConfig(layers=8, samples=3, softness=0.05)
    y, x = np.mgrid[:SIZE, :SIZE]
    head = jnp.asarray(0.84 + 0.001 * x - 0.002 * y)

    def measure(p, head):
        return measures(
            observe(p, view, look, head_depth=head, between=BETWEEN, config=config)
        )

    assert compare(lambda p: measure(p, head), points) > 0.99
    assert compare(lambda head: measure(points, head), head) > 0.99


def test_gradients_by_appearance_are_those_of_finite_differences():
    points, look = two_wisps()
    view = camera_view(make_camera())

    def measure(width, radiance):
        look = Appearance(width, radiance)
        return measures(observe(points, view, look, between=BETWEEN, config=CONFIG))

    width = jnp.full((80, 1), 2e-3)
    assert compare(lambda w: measure(w, look.radiance), width, step=1e-8) > 0.99
    assert compare(lambda c: measure(width, c), look.radiance) > 0.999


def test_gradients_by_lights_and_fibres_are_those_of_finite_differences():
    points, look = two_wisps()
    view = camera_view(make_camera())
    fibre = Fibre(FRONT, BACK, jnp.ones(3), jnp.asarray(9.0))
    config = ShadowConfig(16, 1.0, OpacityConfig(slabs=6, samples=2))

    def measure(numbers):
        light = DistantLight(numbers[:3], jnp.ones(3))
        shone = eqx.tree_at(lambda f: f.diffuse, fibre, numbers[3:6])
        eye, width = numbers[6:9], look.width
        radiance = shade(
            points, width, eye, shone, [light], ambient=jnp.ones(3), config=config
        )
        lit = Appearance(width, radiance)
        return measures(observe(points, view, lit, between=BETWEEN, config=CONFIG))

    numbers = jnp.array([0.3, -1.0, -0.5, 0.5, 0.4, 0.3, 0.0, 0.0, -0.8])
    assert compare(measure, numbers) > 0.99


def test_opacity_of_thin_hair_adds_up_to_the_projected_area():
    points, appearance = two_wisps()
    thin = eqx.tree_at(lambda a: a.width, appearance, jnp.asarray(2e-6))
    points, view = 0.7 * points, camera_view(make_camera())  # wholly in the picture
    seen = observe(points, view, thin, config=CONFIG)
    opacity = -np.log1p(-np.asarray(seen.coverage)).sum()
    found = jax.vmap(jax.vmap(view.see))(points)
    length = np.linalg.norm(np.diff(found.pixel, axis=1), axis=-1)
    scale = 0.5 * (found.scale[:, :-1] + found.scale[:, 1:])
    assert opacity == pytest.approx(float((length * scale * 2e-6).sum()), rel=1e-3)


@pytest.mark.parametrize("share", [0.1, 0.4, 0.9])
@pytest.mark.parametrize("blur", [0.5, 1.0])
def test_a_hair_hides_its_width_of_each_pixel_that_it_crosses(share, blur):
    camera = make_camera()
    f = float(camera.K[0, 0])
    y = np.linspace(-0.08, 0.08, 9)
    strand = np.stack([np.full(9, 0.5 * 0.8 / f), y, np.zeros(9)], -1)[None]
    look = Appearance(jnp.asarray(share * 0.8 / f), jnp.ones((1, 9, 3)))
    config = ObserveConfig(layers=4, samples=20, blur=blur)
    seen = observe(jnp.asarray(strand), camera_view(camera), look, config=config)
    np.testing.assert_allclose(seen.coverage[8:24, 16], share, rtol=0.02)
    np.testing.assert_allclose(seen.coverage[:, :16], 0.0, atol=1e-12)


def first(look):
    """Return the look of the front wisp alone."""
    return Appearance(look.width, look.radiance[:40])


def one_strand(start, end, knots=4):
    share = jnp.linspace(0.0, 1.0, knots)[:, None]
    p = (1.0 - share) * jnp.array(start)[None] + share * jnp.array(end)[None]
    return p[None], Appearance(jnp.asarray(1e-3), jnp.ones((1, knots, 3)))


@pytest.mark.parametrize("degrees", [0.0, 30.0, 90.0, 150.0])
def test_one_fibre_has_the_angle_at_which_it_is_seen(degrees):
    a = np.radians(degrees)
    end = 0.03 * np.array([np.cos(a), np.sin(a), 0.0])
    points, look = one_strand(-end, end)
    seen = observe(points, camera_view(make_camera()), look, config=CONFIG)
    cos2, sin2 = seen.orientation.sum((0, 1))
    angle = 0.5 * np.arctan2(sin2, cos2)
    assert np.cos(2 * (angle - a)) == pytest.approx(1.0, abs=1e-9)
    length = jnp.linalg.norm(seen.orientation, axis=-1)
    np.testing.assert_allclose(length, seen.coverage, atol=1e-6)


def test_depth_and_colour_of_one_fibre_are_its_own():
    points, look = one_strand([-0.03, 0.0, 0.02], [0.03, 0.0, 0.02])
    seen = observe(points, camera_view(make_camera()), look, config=CONFIG)
    hair = np.asarray(seen.coverage) > 1e-4
    np.testing.assert_allclose(seen.depth[hair], 0.82, atol=1e-6)
    assert not np.asarray(seen.depth)[np.asarray(seen.coverage) == 0.0].any()
    np.testing.assert_allclose(seen.colour[..., 1], seen.coverage, atol=1e-9)


def test_a_front_wisp_hides_a_back_wisp():
    points, look = two_wisps()
    thick = Appearance(jnp.asarray(3e-2), look.radiance)
    view = camera_view(make_camera())
    both = observe(points, view, thick, between=BETWEEN, config=CONFIG)
    alone = observe(points[:40], view, first(thick), between=BETWEEN, config=CONFIG)
    dense = np.asarray(alone.coverage) > 0.999
    assert dense.sum() > 20
    np.testing.assert_allclose(
        both.colour[dense], np.broadcast_to(FRONT, (dense.sum(), 3)), atol=5e-3
    )
    np.testing.assert_allclose(both.depth[dense], alone.depth[dense], atol=2e-3)


def test_a_front_wisp_that_moves_over_a_back_wisp_changes_its_colour():
    points, look = two_wisps()
    view = camera_view(make_camera())

    def red(move):
        shift = jnp.concatenate([jnp.full(40, 1.0), jnp.zeros(40)])[:, None, None]
        moved = points + shift * jnp.stack([move, 0.0 * move, 0.0 * move])[None, None]
        seen = observe(moved, view, look, between=BETWEEN, config=CONFIG)
        return seen.colour[..., 2].sum()

    for move in (-0.02, 0.01):
        at, step = jnp.asarray(move), 1e-6
        expected = (red(at + step) - red(at - step)) / (2.0 * step)
        assert float(jax.grad(red)(at)) == pytest.approx(float(expected), rel=1e-3)


def test_a_head_hides_what_lies_behind_it_and_nothing_else():
    points, look = two_wisps()
    view = camera_view(make_camera())
    head = jnp.full((SIZE, SIZE), 0.8)
    seen = observe(points, view, look, head_depth=head, between=BETWEEN, config=CONFIG)
    front = observe(points[:40], view, first(look), between=BETWEEN, config=CONFIG)
    np.testing.assert_allclose(seen.coverage, front.coverage, atol=1e-12)
    none = jnp.full((SIZE, SIZE), jnp.inf)
    free = observe(points, view, look, head_depth=none, between=BETWEEN, config=CONFIG)
    bare = observe(points, view, look, between=BETWEEN, config=CONFIG)
    np.testing.assert_allclose(free.colour, bare.colour, atol=1e-12)


def test_all_is_finite_where_nothing_is_regular():
    through = jnp.stack([jnp.zeros(5), jnp.zeros(5), jnp.linspace(-1.2, 0.2, 5)], -1)
    eye = jnp.array([0.0, 0.0, -0.8])
    points = jnp.stack(
        [
            through,  # through the camera and along its axis
            through + jnp.array([[0.01, 0.0, 0.0]]),
            jnp.zeros((5, 3)),  # no length
            jnp.broadcast_to(eye, (5, 3)),
            jnp.stack([eye, *jnp.zeros((4, 3))]),
            jnp.full((5, 3), 50.0).at[:, 2].set(-0.7989),  # far beside the picture
        ]
    )
    look = Appearance(jnp.asarray(1e-3), jnp.ones((6, 5, 3)))
    camera = make_camera()

    def total(points, camera, width, head):
        seen = observe(
            points,
            camera_view(camera),
            Appearance(width, look.radiance.astype(width.dtype)),
            head_depth=head,
            config=CONFIG,
        )
        return sum(x.sum() for x in seen)

    head = jnp.full((SIZE, SIZE), 0.75).at[0].set(jnp.inf)
    slope = jax.jit(jax.value_and_grad(total, (0, 1, 2, 3)))
    for kind in (jnp.float32, jnp.float64):
        arguments = jax.tree.map(
            lambda x, kind=kind: x.astype(kind), (points, camera, look.width, head)
        )
        value, slopes = slope(*arguments)
        assert jnp.isfinite(value)
        assert all(jnp.isfinite(x).all() for x in jax.tree.leaves(slopes))


def test_hair_behind_the_eye_is_not_seen():
    points, look = one_strand([-0.03, 0.0, -1.0], [0.03, 0.0, -1.0])
    view = camera_view(make_camera())
    seen, slope = jax.value_and_grad(
        lambda p: observe(p, view, look, config=CONFIG).coverage.sum()
    )(points)
    assert float(seen) == 0.0
    assert not slope.any()


def test_half_the_pixels_see_the_same_coverage_in_the_mean():
    points, look = two_wisps()
    look = Appearance(jnp.asarray(1e-4), look.radiance)
    means = []
    for size in (64, 32):
        view = camera_view(make_camera(size))
        config = ObserveConfig(samples=samples_needed(points, view))
        means.append(float(observe(points, view, look, config=config).coverage.mean()))
    assert means[1] == pytest.approx(means[0], rel=0.03)


def test_both_forms_of_sums_agree():
    points, look = two_wisps()
    view = camera_view(make_camera())

    def loss(p, form):
        config = ObserveConfig(layers=8, samples=3, form=form)
        seen = observe(p, view, look, between=BETWEEN, config=config)
        return measures(seen).sum()

    (a, slope_a), (b, slope_b) = (
        jax.value_and_grad(loss)(points, form) for form in ("scatter", "gather")
    )
    assert float(a) == pytest.approx(float(b), rel=1e-12)
    np.testing.assert_allclose(slope_a, slope_b, atol=1e-8)


def test_single_precision_is_enough_for_gradients():
    points, look = two_wisps()
    view = camera_view(make_camera())

    def loss(p, view, look, between):
        return measures(observe(p, view, look, between=between, config=CONFIG)).sum()

    exact = (points, view, look, BETWEEN)
    single = jax.tree.map(lambda x: x.astype(jnp.float32), exact)
    a, b = (np.ravel(jax.jit(jax.grad(loss))(*x)) for x in (exact, single))
    assert b.dtype == np.float32
    assert a @ b / (np.linalg.norm(a) * np.linalg.norm(b)) > 0.9999


def memory(strands, size):
    """Return the temporary memory of a gradient, in bytes."""
    points = jnp.zeros((strands, 33, 3), jnp.float32)
    look = Appearance(jnp.asarray(1e-4, jnp.float32), jnp.zeros_like(points))
    view = camera_view(make_camera(size))
    view = jax.tree.map(lambda x: x.astype(jnp.float32), view)

    def loss(p):
        config = ObserveConfig(samples=2)
        return sum(x.sum() for x in observe(p, view, look, config=config))

    compiled = jax.jit(jax.grad(loss)).lower(points).compile()
    analysis = compiled.memory_analysis()
    assert analysis is not None
    return analysis.temp_size_in_bytes


def test_memory_grows_with_segments_and_pixels_not_with_their_product():
    base, more, finer = memory(200, 64), memory(800, 64), memory(200, 128)
    both = memory(800, 128)
    assert both - base < 1.2 * (more - base + finer - base)
    assert both < 300 * (800 * 32 * 2 * 4) + 40 * (128**2 * 16 * 4)


def test_the_share_of_a_thin_layer_is_exact_on_both_sides_of_the_series():
    opacity = jnp.array([0.0, 0.99e-5, 1.01e-5, 1.0])
    exact = [1.0, 1.0 - 0.495e-5, 1.0 - 0.505e-5, 1.0 - np.exp(-1.0)]
    np.testing.assert_allclose(seen_share(opacity), exact, atol=1e-10)


def test_what_cannot_be_is_refused():
    points, look = two_wisps()
    view = camera_view(make_camera())
    with pytest.raises(ValueError, match="at least 2 layers, got 1"):
        ObserveConfig(layers=1)
    with pytest.raises(ValueError, match="above 0 and at most 1, got 0.0"):
        ObserveConfig(blur=0.0)
    with pytest.raises(ValueError, match="call `samples_needed` first"):
        jax.jit(lambda p: observe(p, view, look))(points)


def test_as_many_samples_as_pixels_are_needed():
    points, look = one_strand([-0.03, 0.0, 0.0], [0.03, 0.0, 0.0], 2)
    view = camera_view(make_camera())
    assert isinstance(view, View)
    # 0.06 m at 0.8 m and a focal length of 224 pixels are 16.8 pixels.
    assert samples_needed(points, view) == 17
    seen = observe(points, view, look)
    assert float(seen.coverage.max()) > 0.0
