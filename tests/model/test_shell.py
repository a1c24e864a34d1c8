import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads

from hairfit.model.coons import CoonsPatch, coons_patch
from hairfit.model.curve import catmull_rom
from hairfit.model.shell import (
    ShellGrid,
    ShellHair,
    ThinShell,
    cell_of,
    even_hair,
    particle_shadow,
    shell_coordinates,
    shell_density,
    shell_place,
    shell_point,
    shell_shadow,
    shell_strands,
)

GRID = ShellGrid(5, 6, 4)
points_of = jax.jit(jax.vmap(shell_point, (None, 0)))


def boundaries(seed=0, knots=(5, 4, 6, 3)):
    """Four wild curves whose corners meet."""
    rng = np.random.default_rng(seed)
    u1, u2, v1, v2 = (jnp.asarray(rng.normal(size=(n, 3))) for n in knots)
    v1 = v1.at[0].set(u1[0]).at[-1].set(u2[0])
    v2 = v2.at[0].set(u1[-1]).at[-1].set(u2[-1])
    return u1, u2, v1, v2


def middles(rows):
    return jnp.asarray((np.arange(rows) + 0.5) / rows)


def tube(s, t):
    """A quarter of a tube of 0.1 m radius about the y axis, 0.2 m long."""
    angle = 0.5 * jnp.pi * jnp.asarray(s)
    axis = -0.2 * jnp.asarray(t)
    return jnp.stack([0.1 * jnp.sin(angle), axis, 0.1 * jnp.cos(angle)])


def bowed() -> CoonsPatch:
    x = jnp.linspace(0.0, 1.0, 6)
    flat, bow = jnp.zeros(6), 0.05 * jnp.sin(jnp.pi * x)
    u1 = jnp.stack([0.2 * x, flat, 0.3 * bow], 1)
    side = jnp.stack([0.4 * bow, -0.25 * x, bow], 1)
    return coons_patch(u1, u1 + side[-1:], side + u1[:1], side + u1[-1:])


def test_a_patch_runs_through_all_four_boundaries():
    curves = boundaries()
    patch = coons_patch(*curves)
    point = jax.jit(jax.vmap(lambda s, t: patch(s, t)))
    x = jnp.linspace(0.0, 1.0, 23)
    zero, one = jnp.zeros(23), jnp.ones(23)
    places = ((x, zero), (x, one), (zero, x), (one, x))
    for control, (s, t) in zip(curves, places, strict=True):
        want = jax.vmap(catmull_rom, (None, 0))(control, x)
        assert jnp.allclose(point(s, t), want, atol=1e-12)


def test_boundaries_may_be_any_callables():
    # Four sides of the surface z = s^2 + t, which is ruled: the patch is the surface.
    patch = CoonsPatch(
        lambda s: jnp.stack([s, 0.0 * s, s**2]),
        lambda s: jnp.stack([s, 1.0 + 0.0 * s, s**2 + 1.0]),
        lambda t: jnp.stack([0.0 * t, t, t]),
        lambda t: jnp.stack([1.0 + 0.0 * t, t, 1.0 + t]),
    )
    for s, t in ((0.3, 0.2), (0.5, 0.9)):
        assert jnp.allclose(patch(s, t), jnp.array([s, t, s**2 + t]), atol=1e-14)


def test_a_ruled_patch_between_lines_is_bilinear():
    corner = np.random.default_rng(3).normal(size=(2, 2, 3))
    lines = [jnp.asarray(corner[i, j]) for i, j in ((0, 0), (0, 1), (1, 0), (1, 1))]
    a, b, c, d = lines
    patch = coons_patch(*(jnp.stack(x) for x in ((a, b), (c, d), (a, c), (b, d))))
    s, t = 0.3, 0.8
    want = (1 - s) * (1 - t) * a + s * (1 - t) * b + (1 - s) * t * c + s * t * d
    assert jnp.allclose(patch(s, t), want, atol=1e-14)


@pytest.mark.parametrize(
    ("curve", "end", "where"),
    [
        (2, 0, "u1 begins and v1 begins"),
        (3, 0, "u1 ends and v2 begins"),
        (2, -1, "u2 begins and v1 ends"),
        (3, -1, "u2 ends and v2 ends"),
    ],
)
def test_open_boundaries_are_refused(curve, end, where):
    curves = list(boundaries())
    curves[curve] = curves[curve].at[end].add(0.1)
    with pytest.raises(ValueError, match=where):
        coons_patch(*curves)


def test_the_thickness_is_in_metres():
    shell = ThinShell(tube, jnp.asarray(0.02))
    s, t = 0.3, 0.6
    place = shell_place(shell, s, t)
    outwards = tube(s, t) * jnp.array([10.0, 0.0, 10.0])
    assert jnp.allclose(place.normal, -outwards, atol=1e-14) or jnp.allclose(
        place.normal, outwards, atol=1e-14
    )
    for u in (0.0, 0.5, 1.0):
        p = shell_point(shell, jnp.array([s, t, u]))
        radius = jnp.hypot(p[0], p[2])
        assert jnp.allclose(jnp.abs(radius - 0.1), 0.02 * u, atol=1e-14)


def test_s_t_and_the_normal_are_right_handed():
    shell = ThinShell(bowed(), jnp.asarray(0.01))
    place = shell_place(shell, 0.4, 0.3)
    along_s = shell.surface(0.41, 0.3) - shell.surface(0.39, 0.3)
    along_t = shell.surface(0.4, 0.31) - shell.surface(0.4, 0.29)
    assert jnp.dot(jnp.cross(along_s, along_t), place.normal) > 0.0
    assert jnp.allclose(jnp.linalg.norm(place.normal), 1.0, atol=1e-14)


def test_a_patch_pinched_to_a_point_has_no_thickness_there_and_finite_gradients():
    tip = jnp.zeros((2, 3))
    a, b = jnp.array([-0.1, -0.2, 0.0]), jnp.array([0.1, -0.2, 0.0])
    sides = jnp.stack([a, b]), jnp.stack([tip[0], a]), jnp.stack([tip[0], b])
    shell = ThinShell(coons_patch(tip, *sides), jnp.asarray(0.01))
    stu = jnp.array([0.5, 0.0, 1.0])
    assert jnp.allclose(shell_point(shell, stu), 0.0, atol=1e-14)
    slope = jax.jit(jax.jacrev(shell_point, argnums=1))(shell, stu)
    assert jnp.all(jnp.isfinite(slope))


def test_shell_coordinates_undo_the_warp():
    shell = ThinShell(bowed(), jnp.asarray(0.015))
    stu = jnp.asarray(np.random.default_rng(1).uniform(size=(60, 3)))
    back = jax.jit(jax.vmap(shell_coordinates, (None, 0)))(shell, points_of(shell, stu))
    assert jnp.allclose(back, stu, atol=1e-9)


def test_gradients_of_the_warp():
    shell = ThinShell(bowed(), jnp.asarray(0.015))
    check_grads(
        jax.jit(shell_point), (shell, jnp.array([0.33, 0.71, 0.4])), order=1, eps=1e-6
    )


@pytest.mark.parametrize(
    ("count", "columns", "layers"), [(0, 3, 2), (5, 3, 2), (100, 3, 5), (391, 1, 4)]
)
def test_even_hair_fills_cells_evenly(count, columns, layers):
    grid = ShellGrid(columns, 3, layers)
    hair = even_hair(count, grid, jax.random.key(count))
    assert hair.s.shape == hair.u.shape == (count, 3)
    assert np.all(np.asarray(hair.s) == np.asarray(hair.s)[:, :1])
    cell = np.asarray(cell_of(hair.s, columns) * layers + cell_of(hair.u, layers))
    for row in range(3):
        counts = np.bincount(cell[:, row], minlength=columns * layers)
        assert counts.max() - counts.min() <= 1
        assert counts.sum() == count


def test_hair_begins_close_to_0_and_ends_close_to_1():
    hair = even_hair(10, ShellGrid(2, 20, 2), jax.random.key(0))
    assert jnp.allclose(hair.t[jnp.array([0, -1])], jnp.array([0.025, 0.975]))


def test_strands_run_through_their_particles():
    shell = ThinShell(bowed(), jnp.asarray(0.01))
    rng = np.random.default_rng(2)
    t = middles(6)
    s, u = (jnp.asarray(rng.uniform(0.2, 0.8, size=(7, 6))) for _ in range(2))
    strands = shell_strands(shell, ShellHair(s, u, t), 16)
    for i in range(7):
        stu = jnp.stack([s[i], t, u[i]], axis=1)
        assert jnp.allclose(strands[i, ::3], points_of(shell, stu), atol=1e-12)


def test_strands_stay_in_the_shell_where_curves_overshoot():
    shell = ThinShell(
        lambda s, t: jnp.stack([jnp.asarray(s), jnp.asarray(t), jnp.zeros_like(s)]),
        jnp.asarray(1.0),
    )
    steps = jnp.asarray(np.random.default_rng(0).integers(0, 2, size=(50, 8)), float)
    t = middles(8)
    strands = shell_strands(shell, ShellHair(steps, 1.0 - steps, t), 60)
    assert jnp.all((strands >= -1e-12) & (strands <= 1.0 + 1e-12))


def test_a_lagrange_curve_of_20_particles_swings():
    # Why strands are Catmull-Rom curves: one particle off by 1, seen between the ends.
    knots, x = np.linspace(0.0, 1.0, 20), np.linspace(0.0, 1.0, 400)
    others = np.delete(knots, 9)
    swing = np.prod((x[:, None] - others) / (knots[9] - others), axis=1)
    assert np.abs(swing).max() > 1000.0
    bump = jnp.zeros((20, 1)).at[9].set(1.0)
    curve = jax.vmap(catmull_rom, (None, 0))(bump, jnp.asarray(x))
    assert jnp.max(jnp.abs(curve)) <= 1.0 + 1e-12


def test_density_counts_the_particles_of_each_cell():
    rng = np.random.default_rng(4)
    s, u = rng.uniform(size=(2, 90, GRID.rows))
    hair = ShellHair(jnp.asarray(s), jnp.asarray(u), middles(6))
    want = np.zeros((5, 6, 4))
    for strand in range(90):
        for j in range(6):
            i, k = int(s[strand, j] * 5), int(u[strand, j] * 4)
            want[i, j, k] += 20 / 90
    assert np.allclose(shell_density(hair, GRID), want, atol=1e-12)


def test_shadow_grows_inwards_from_none():
    density = jnp.asarray(np.random.default_rng(5).uniform(size=(3, 2, 4)))
    shadow = np.asarray(shell_shadow(density, 0.7))
    assert np.all(shadow[:, :, 3] == 0.0)
    for k in (2, 1, 0):
        want = shadow[:, :, k + 1] + 0.7 * density[:, :, k + 1]
        assert np.allclose(shadow[:, :, k], want, atol=1e-14)


def test_particles_have_the_shadow_of_their_cells_with_a_little_noise():
    hair = even_hair(400, GRID, jax.random.key(0))
    shadow = shell_shadow(shell_density(hair, GRID), 1.0)
    exact = particle_shadow(hair, shadow, 0.0, jax.random.key(1))
    layer = cell_of(hair.u, GRID.layers)
    assert jnp.allclose(exact, 3.0 - layer.astype(float), atol=1e-9)
    noisy = particle_shadow(hair, shadow, 0.2, jax.random.key(1))
    assert jnp.all(jnp.abs(noisy - exact) <= 0.2) and jnp.any(noisy != exact)
    assert jnp.all(noisy >= 0.0)


def test_a_grid_of_other_rows_is_refused():
    hair = even_hair(10, GRID, jax.random.key(0))
    with pytest.raises(ValueError, match="grid of 7 rows got strands of 6 particles"):
        shell_density(hair, ShellGrid(5, 7, 4))
