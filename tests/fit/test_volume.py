import jax
import jax.numpy as jnp
import numpy as np
import pytest
from ball_hair import RADIUS, hull_where
from jax.test_util import check_grads

from hairfit.fit.evidence import Field
from hairfit.fit.volume import (
    CLEARANCE,
    DRAWN,
    FARTHEST,
    GAP,
    SHAPES,
    SIGMA_FIELD,
    SIGMA_GAP,
    SIGMA_INSIDE_HEAD,
    field_loss,
    find_gaps,
    gap_loss,
    hair_volume,
    head_field,
    head_loss,
    inner_places,
    room_for,
    roomy,
)


def exact(module):
    """Return fields in float64, for gradients."""
    return jax.tree.map(lambda x: x.astype(float), module)


def block(direction, sure=1.0):
    """Return a cube full of hair along one direction, its signs at random."""
    hull = hull_where(
        lambda p: np.abs(p).max(axis=1) < 0.05, [-0.06] * 3, [0.06] * 3, 0.004
    )
    unit = np.asarray(direction, float) / np.linalg.norm(direction)
    signs = np.random.default_rng(0).choice([-1.0, 1.0], hull.grid.shape)
    field = Field(signs[..., None] * unit, np.full(hull.grid.shape, float(sure)))
    return hull, exact(hair_volume(hull, field))


def bundle(angle=0.0, spacing=0.01, half=0.04, knots=9):
    """Return parallel strands that fill a square, `angle` away from straight down."""
    side = np.arange(-half, half + 1e-9, spacing)
    x, z = np.meshgrid(side, side)
    root = np.stack([x, np.full_like(x, half), z], axis=-1).reshape(-1, 1, 3)
    along = np.array([np.sin(angle), -np.cos(angle), 0.0])
    return root + np.linspace(0.0, 2 * half, knots)[None, :, None] * along


@pytest.mark.parametrize("angle", [0.1, 0.5, 1.2])
@pytest.mark.parametrize("sure", [1.0, 0.3])
def test_the_fields_loss_is_the_sine_of_the_angle_however_sure_it_is(angle, sure):
    _, volume = block([0.0, 1.0, 0.0], sure)
    found = field_loss(jnp.asarray(bundle(angle, half=0.02)), volume)
    assert np.isclose(found * SIGMA_FIELD, np.sin(angle), atol=5e-3)


def test_along_the_field_the_loss_is_zero_and_its_gradient_finite():
    _, volume = block([0.0, 1.0, 0.0])
    strands = jnp.asarray(bundle(0.0))
    assert abs(field_loss(strands, volume)) < 1e-4
    still = jnp.zeros_like(strands)
    assert np.isfinite(jax.grad(lambda s: field_loss(s, volume))(still)).all()


def test_the_fields_gradient_is_right():
    _, volume = block([0.3, 1.0, 0.2])
    strands = jnp.asarray(bundle(0.4, half=0.012, knots=5)) + 0.00131
    loss = jax.jit(lambda s: field_loss(s, volume))
    check_grads(loss, (strands,), order=1, modes=["rev"], eps=1e-7, rtol=1e-3)


def test_a_full_block_has_no_gaps_and_a_hole_is_found_with_its_neighbour():
    places = bundle(0.0, spacing=0.004).reshape(-1, 3)
    full = bundle(0.0, spacing=0.004)
    assert float(find_gaps(full, places, 0).share.sum()) == 0.0
    middle = np.hypot(full[:, 0, 0], full[:, 0, 2]) < 0.009
    holed = full[~middle]
    gaps = find_gaps(holed, places, 0)
    share = np.asarray(gaps.share)
    empty = np.repeat(middle, full.shape[1]).reshape(len(full), -1)
    # All places of the hole but those near its border, and those at the roots' height.
    assert 0.5 * empty.mean() < share.sum() <= empty.mean()
    found = share > 0
    place = np.asarray(gaps.place)[found]
    near = holed[np.asarray(gaps.strand)[found], np.asarray(gaps.point)[found]]
    assert (np.hypot(place[:, 0], place[:, 2]) < 0.009).all()
    away = np.linalg.norm(place - near, axis=1)
    closest = np.linalg.norm(
        place[:, None] - holed[:, 1:].reshape(1, -1, 3), axis=2
    ).min(axis=1)
    assert (away > GAP).all()
    assert np.allclose(away, closest, atol=0.003)
    assert len(share) == DRAWN


def test_the_loss_of_gaps_is_the_distance_up_to_the_farthest():
    strands = bundle(0.0, spacing=0.05, half=0.025)[:1]
    place = strands[0, 4] + [0.007, 0.0, 0.0]
    gaps = find_gaps(strands, place[None], 0)
    loss = gap_loss(jnp.asarray(strands, jnp.float32), gaps)
    assert np.isclose(float(loss) * SIGMA_GAP, 0.007, rtol=1e-4)
    far = find_gaps(strands, place[None] + [FARTHEST, 0.0, 0.0], 0)
    assert float(far.share.sum()) == 0.0


def test_roots_are_not_drawn():
    strands = bundle(0.0, spacing=0.05, half=0.025)[:1]
    above = strands[0, 0] + [0.0, 0.01, 0.0]
    gaps = find_gaps(strands, above[None], 0)
    assert int(gaps.point[0]) > 0


def test_places_where_hair_should_be_lie_within_the_hull():
    hull, _ = block([0.0, 1.0, 0.0])
    inner = inner_places(hull)
    assert np.abs(inner).max() < 0.05 - 0.002
    assert len(inner) > 0.6 * hull.hair.sum()


@pytest.fixture(scope="module")
def skin():
    """The distance to the ball on a grid, as a field."""
    hull = hull_where(
        lambda p: np.linalg.norm(p, axis=1) > RADIUS,
        [-0.1] * 3,
        [0.1] * 3,
        0.005,
        head=lambda p: np.linalg.norm(p, axis=1) - RADIUS,
    )
    return exact(head_field(hull))


def radial(start, end, knots=6):
    """Return one strand along a radius of the ball."""
    along = np.array([0.6, 0.64, 0.48])
    return jnp.asarray(np.linspace(start, end, knots)[:, None] * along)[None]


def test_outside_the_head_the_loss_is_zero_and_roots_are_free(skin):
    assert head_loss(radial(RADIUS + 0.002, 0.1), skin) == 0.0
    strand = radial(RADIUS + 0.002, 0.1).at[:, 0].set(0.0)
    assert head_loss(strand, skin) == 0.0


def test_the_heads_loss_grows_with_the_depth(skin):
    for depth in (0.0, 0.002, 0.01):
        deep = (depth + CLEARANCE) / SIGMA_INSIDE_HEAD
        found = head_loss(radial(RADIUS - depth, RADIUS - depth), skin)
        assert np.isclose(found, deep**2 / (1 + deep), rtol=0.1)


def test_the_heads_losss_gradient_is_right_and_points_inwards(skin):
    strand = radial(RADIUS + 0.001, RADIUS - 0.006)
    loss = jax.jit(lambda s: head_loss(s, skin))
    check_grads(loss, (strand,), order=1, modes=["rev"], eps=1e-7, rtol=1e-3)
    gradient = np.asarray(jax.grad(loss)(strand))[0]
    assert (gradient[0] == 0).all()
    outward = np.asarray(strand[0])
    assert (np.sum(gradient[-2:] * outward[-2:], axis=1) < 0).all()


def test_a_roomy_grid_goes_on_as_at_its_border():
    values = np.random.default_rng(0).normal(size=(5, SHAPES, SHAPES + 1, 2))
    found = roomy(values)
    assert found.shape == (SHAPES, SHAPES, 2 * SHAPES, 2)
    assert np.array_equal(found[:5, :, : SHAPES + 1], values)
    assert (found[4:, :, :] == found[4:5, :, :]).all()
    assert (found[:, :, SHAPES:] == found[:, :, SHAPES : SHAPES + 1]).all()
    assert room_for((5, SHAPES, SHAPES + 1)) == found.shape[:3]
