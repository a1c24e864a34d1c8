import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hairfit.model.combing import (
    Comb,
    comb_draws,
    comb_hair,
    comb_repeatedly,
    even_comb,
    lift_combed,
    reflect,
    tooth_influence,
    tooth_reach,
)
from hairfit.model.curve import catmull_rom
from hairfit.model.shell import ShellGrid, ShellHair, cell_of, even_hair

GRID = ShellGrid(6, 8, 4)
lift = jax.jit(lift_combed, static_argnums=4)
reach_of = jax.jit(jax.vmap(tooth_reach, (None, 0)))
influence_of = jax.jit(jax.vmap(tooth_influence, (None, None, 0, 0)))


def make(path, bottom=0.1, top=0.3, depth=0.6) -> Comb:
    numbers = (jnp.asarray(x) for x in (bottom, top, depth))
    return Comb(jnp.asarray(path, float), *numbers)


def straight(middle, knots=3):
    return [[middle] * knots]


def wavy(seed=0) -> Comb:
    sway = 0.15 * jnp.sin(jnp.linspace(0.0, 3.0, 5))
    return even_comb(4, sway, jax.random.key(seed))


def test_a_tooth_is_a_trapezoid():
    comb = make(straight(0.5))
    u = jnp.array([1.0, 0.7, 0.46, 0.399, 0.0])  # the tooth ends at 1 - 0.6
    want = jnp.array([0.15, 0.10, 0.06, 0.0, 0.0])
    assert jnp.allclose(reach_of(comb, u), want, atol=1e-12)


def test_influence_falls_from_1_in_the_middle_to_0_at_the_side_and_stays_0():
    comb = make(straight(0.5))
    s = 0.5 + 0.15 * jnp.array([0.0, 0.5, -0.5, 1.0, -1.0, 1.5, -3.0, 1e-9, -1e-9])
    found = influence_of(comb, jnp.array([0.5]), s, jnp.ones(9))
    half = np.sqrt(0.5)
    want = jnp.array([1.0, half, -half, 0.0, 0.0, 0.0, 0.0, 1.0, -1.0])
    assert jnp.allclose(found.pickup, want, atol=1e-12)
    assert jnp.all(found.pickup[3:7] == 0.0)
    below = influence_of(comb, jnp.array([0.5]), s, jnp.full(9, 0.1))
    assert jnp.all(below.pickup == 0.0)


def test_the_nearest_tooth_acts():
    centres = jnp.array([0.2, 0.5, 0.9])
    s = jnp.array([0.0, 0.34, 0.36, 0.71, 1.0])
    found = influence_of(make(np.zeros((3, 2))), centres, s, jnp.ones(5))
    assert found.tooth.tolist() == [0, 0, 1, 2, 2]


def one_row(count, comb, key=1):
    """Hair of one row of particles at u = 0.9, even in s; before and after."""
    s = jnp.asarray((np.arange(count) + 0.5) / count)
    hair = ShellHair(s[:, None], jnp.full((count, 1), 0.9), jnp.array([0.5]))
    return s, comb_hair(hair, comb, ShellGrid(1, 1, 1), jax.random.key(key)).s[:, 0]


def test_particles_are_picked_up_as_often_as_their_influence_says():
    comb = make(straight(0.5), bottom=0.8, top=0.8)
    s, after = one_row(40_000, comb)
    moved = np.asarray(after != s)
    away = np.asarray(s) - 0.5
    for low in np.arange(-0.5, 0.5, 0.1):
        mine = (away >= low) & (away < low + 0.1)
        zone = np.clip(np.abs(away[mine]) / 0.4, 0.0, 1.0)
        want = np.cos(0.5 * np.pi * zone).mean()
        assert abs(moved[mine].mean() - want) < 0.03


def test_hair_gets_sparse_in_the_middle_of_a_tooth_as_figure_3_5_shows():
    # At the distance x of the middle, in units of Z, the share cos(pi x / 2) leaves,
    # and of all that leave on a side, 2 / pi, every place gets the same.
    comb = make(straight(0.5), bottom=1.0, top=1.0)
    after = one_row(40_000, comb)[1]
    counts = np.histogram(np.asarray(after), bins=20, range=(0.0, 1.0))[0] / 2000
    x = np.abs((np.arange(20) + 0.5) / 20 - 0.5) / 0.5
    want = 1.0 - np.cos(0.5 * np.pi * x) + 2.0 / np.pi
    assert np.abs(counts - want).max() < 0.08
    assert counts[9] < 0.75 and counts[0] > 1.5


def test_hair_leaves_a_tooth_on_its_own_side():
    s, after = one_row(40_000, make(straight(0.5), bottom=0.8, top=0.8))
    assert jnp.all((s < 0.5) == (after < 0.5))


def reference(hair, comb, grid, draws):
    """`comb_hair` particle by particle."""
    s, u = np.array(hair.s), np.array(hair.u)
    strands, rows = s.shape
    path = jax.jit(jax.vmap(catmull_rom, (None, 0)))
    centres = np.asarray(path(comb.path.T, hair.t))
    combed = np.zeros((strands, rows), bool)
    bottom, top, depth = float(comb.bottom), float(comb.top), float(comb.depth)
    threshold, place = np.asarray(draws.threshold), np.asarray(draws.place)
    for i in range(strands):
        for j in range(rows):
            tooth = int(np.argmin(np.abs(s[i, j] - centres[j])))
            along = 1 + (u[i, j] - 1) / depth
            half = 0.5 * ((1 - along) * bottom + along * top)
            away = s[i, j] - centres[j, tooth]
            if along < 0 or abs(away) >= half:
                continue
            if np.cos(0.5 * np.pi * away / half) > threshold[i]:
                r = (1 if away >= 0 else -1) * place[i] * half
                for k in range(j, rows):
                    s[i, k] = mirrored(centres[k, tooth] + r)
                    combed[i, k] = True
                break
    for j in range(rows):
        u[:, j] = lifted(s[:, j], u[:, j], combed[:, j], np.asarray(draws.order), grid)
    return s, u, combed


def mirrored(x):
    while not 0 <= x <= 1:
        x = -x if x < 0 else 2 - x
    return x


def lifted(s, u, combed, order, grid):
    """`lift_combed` with lists of particles a cell."""
    columns, layers = grid.columns, grid.layers
    free, used = {}, u.copy()
    cell = [
        (min(int(a * columns), columns - 1), min(int(b * layers), layers - 1))
        for a, b in zip(s, u, strict=True)
    ]
    for i in order:
        if not combed[i]:
            free.setdefault(cell[i], []).append(i)
    for i in order:
        if combed[i]:
            above = free.get((cell[i][0], cell[i][1] + 1), [])
            if above:
                partner = above.pop(0)
                used[i], used[partner] = u[partner], u[i]
            else:
                used[i] = mirrored(u[i] + 1 / grid.layers)
    return used


@pytest.mark.parametrize("seed", [0, 1])
def test_combing_is_what_a_loop_over_particles_does(seed):
    key = jax.random.key(seed)
    hair = even_hair(150, GRID, key)
    hair = comb_hair(hair, wavy(seed), GRID, jax.random.key(7))  # no longer straight
    comb = wavy(seed + 10)
    after = comb_hair(hair, comb, GRID, key)
    s, u, combed = reference(hair, comb, GRID, comb_draws(150, key))
    assert 0.2 < combed.mean() < 0.9
    assert np.allclose(after.s, s, atol=1e-12)
    assert np.allclose(after.u, u, atol=1e-12)
    assert np.array_equal(after.t, hair.t)


@given(
    st.sampled_from([(1, 1), (3, 4), (1, 5)]),
    st.floats(0.0, 1.0),
    st.integers(0, 10**6),
)
@settings(max_examples=25, deadline=None)
def test_swaps_keep_depths_and_lift_combed_hair(cells, share, seed):
    rng = np.random.default_rng(seed)
    columns, layers = cells
    grid = ShellGrid(columns, 1, layers)
    size = 120
    s, u = rng.uniform(size=(2, size))
    combed = rng.uniform(size=size) < share
    order = rng.permutation(size)
    after = np.asarray(lift(*(jnp.asarray(x) for x in (s, u, combed, order)), grid))
    assert np.allclose(after, lifted(s, u, combed, order, grid), atol=1e-14)
    layer = np.minimum((u * layers).astype(int), layers - 1)
    now = np.minimum((after * layers).astype(int), layers - 1)
    assert np.all((after >= 0.0) & (after <= 1.0))
    # Combed hair goes up a layer, but for the top one, where it is reflected.
    assert np.all(now[combed] == np.minimum(layer[combed] + 1, layers - 1))
    # Other hair stays or is pushed down by one.
    assert np.all((now <= layer)[~combed] & (now >= layer - 1)[~combed])
    # Depths are exchanged: those of who moved alone apart, they are what they were.
    pushed = (~combed) & (after != u)
    swapped = combed & np.isin(after, u[pushed])
    assert pushed.sum() == swapped.sum()
    both = pushed | swapped
    assert np.array_equal(np.sort(after[both]), np.sort(u[both]))


def test_nothing_leaves_the_volume_however_often_hair_is_combed():
    hair = even_hair(150, GRID, jax.random.key(0))
    wild = [
        even_comb(4, 0.8 * jnp.sin(jnp.linspace(0, n, 5)), jax.random.key(n))
        for n in (3, 5, 8)
    ]
    after = comb_repeatedly(hair, wild, GRID, jax.random.key(1))
    for x in (after.s, after.u):
        assert jnp.all((x >= 0.0) & (x <= 1.0))
    assert jnp.array_equal(after.t, hair.t)
    assert after.s.shape == hair.s.shape


def test_swept_strands_run_along_the_path_of_their_tooth():
    # One tooth over a flat top layer: who is picked up keeps a signed distance.
    sway = 0.2 * jnp.linspace(0.0, 1.0, GRID.rows)
    comb = Comb((0.4 + sway)[None], *(jnp.asarray(x) for x in (0.3, 0.3, 1.0)))
    hair = even_hair(400, GRID, jax.random.key(3))
    hair = ShellHair(hair.s, hair.u, jnp.linspace(0.0, 1.0, GRID.rows))
    after = comb_hair(hair, comb, GRID, jax.random.key(4))
    r = after.s - (0.4 + sway)[None]
    moved = np.asarray(after.s != hair.s)
    assert moved[:, -1].sum() > 50
    left = right = 0
    for strand in np.flatnonzero(moved[:, -1]):
        first = int(np.argmax(moved[strand]))
        assert np.allclose(r[strand, first:], r[strand, -1], atol=1e-12)
        assert np.all(moved[strand, first:])
        left += int(r[strand, -1] < 0)
        right += int(r[strand, -1] > 0)
    assert left > 10 and right > 10


def test_combing_again_brings_combed_hair_to_the_top():
    hair = even_hair(600, GRID, jax.random.key(0))
    comb = make(straight(0.5), bottom=0.3, top=0.3, depth=1.0)
    after = comb_repeatedly(hair, [comb] * 4, GRID, jax.random.key(1))
    moved = jnp.any(after.s != hair.s, axis=1)
    layer = cell_of(after.u, GRID.layers).astype(float)
    gain = layer - cell_of(hair.u, GRID.layers).astype(float)
    assert jnp.mean(gain[moved]) > 0.5
    assert jnp.mean(gain[~moved]) < 0.0
    assert jnp.mean(layer[moved]) > jnp.mean(layer[~moved]) + 0.5


def test_the_same_key_combs_the_same_way():
    hair = even_hair(150, GRID, jax.random.key(0))
    a, b, c = (comb_hair(hair, wavy(), GRID, jax.random.key(k)) for k in (1, 1, 2))
    assert jnp.array_equal(a.s, b.s) and jnp.array_equal(a.u, b.u)
    assert not jnp.array_equal(a.s, c.s)


@given(st.floats(-7.0, 7.0))
@settings(max_examples=50, deadline=None)
def test_reflection_folds_the_line_onto_the_unit_interval(x):
    assert float(reflect(x)) == pytest.approx(mirrored(x), abs=1e-12)


def test_even_teeth_do_not_interfere():
    comb = even_comb(12, jnp.zeros(4), jax.random.key(0), variation=0.0)
    gap = jnp.diff(comb.path, axis=0)
    assert jnp.allclose(gap, comb.top, atol=1e-14)
    assert jnp.allclose(comb.path[0] - 0.5 * comb.top, 0.0, atol=1e-14)


def test_single_precision_stays_single():
    hair, comb = jax.tree.map(
        lambda x: x.astype(jnp.float32),
        (even_hair(50, GRID, jax.random.key(0)), wavy()),
    )
    after = comb_hair(hair, comb, GRID, jax.random.key(0))
    assert after.s.dtype == after.u.dtype == jnp.float32


def test_a_comb_without_teeth_is_refused():
    with pytest.raises(ValueError, match="at least 1 tooth, got 0"):
        even_comb(0, jnp.zeros(3), jax.random.key(0))


def test_hair_of_other_rows_than_the_grid_is_refused():
    hair = even_hair(10, GRID, jax.random.key(0))
    with pytest.raises(ValueError, match="grid of 9 rows got strands of 8"):
        comb_hair(hair, wavy(), ShellGrid(6, 9, 4), jax.random.key(0))
