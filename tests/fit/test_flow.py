import numpy as np
import pytest
from ball_hair import all_centres, hull_where

from hairfit.fit.evidence import Field
from hairfit.fit.flow import (
    HANGS,
    STANDS,
    Links,
    fallen,
    hair_flow,
    how_it_falls,
    solve_potential,
)

SPACING = 0.004


def signless(hull, direction, seed=0):
    """Return a field along `direction` of every voxel, its signs at random."""
    unit = direction / np.linalg.norm(direction, axis=-1, keepdims=True)
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], hull.grid.shape)
    return Field(unit * signs[..., None], np.ones(hull.grid.shape))


def scalp_at(height, half=0.08, step=0.003):
    side = np.linspace(-half, half, round(2 * half / step))
    x, z = np.meshgrid(side, side)
    return np.stack([x, np.full_like(x, height), z], axis=-1).reshape(-1, 3)


def test_hair_hangs_down_from_a_scalp_on_top_whatever_the_signs():
    hull = hull_where(
        lambda p: (np.hypot(p[:, 0], p[:, 2]) < 0.03) & (p[:, 1] > -0.15),
        [-0.04, -0.16, -0.04],
        [0.04, 0.0, 0.04],
        SPACING,
    )
    field = signless(hull, np.tile([0.0, 1.0, 0.0], (*hull.grid.shape, 1)))
    flow = hair_flow(hull, field, scalp_at(0.0))
    assert (flow[hull.hair][:, 1] < -0.9).all()
    assert np.allclose(np.linalg.norm(flow, axis=-1), 1.0)


def test_hair_on_a_flat_scalp_flows_to_the_side_where_it_hangs():
    # A plate of hair lies on a scalp; over one border alone it hangs down.
    def inside(p):
        plate = (np.abs(p[:, 1]) < 0.008) & (np.abs(p[:, 0]) < 0.06)
        curtain = (np.abs(p[:, 0] - 0.052) < 0.008) & (p[:, 1] < 0) & (p[:, 1] > -0.12)
        return (plate | curtain) & (np.abs(p[:, 2]) < 0.03)

    hull = hull_where(inside, [-0.07, -0.13, -0.04], [0.07, 0.02, 0.04], SPACING)
    centres = all_centres(hull)
    hangs = (centres[..., 0] > 0.044) & (centres[..., 1] < -0.004)
    along = np.where(hangs[..., None], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0])
    field = signless(hull, along)
    flow = hair_flow(hull, field, scalp_at(-0.008, half=0.04))
    lies = hull.hair & (np.abs(centres[..., 0]) < 0.015)
    assert (flow[lies][:, 0] > 0.5).mean() > 0.95
    assert (flow[hull.hair & hangs][:, 1] < -0.5).mean() > 0.95


def test_stubble_beside_long_hair_ends_where_it_stands():
    # A shaved plate, and a tall column over one end of it.
    def inside(p):
        plate = (np.abs(p[:, 1]) < 0.008) & (np.abs(p[:, 0]) < 0.06)
        column = (np.abs(p[:, 0] - 0.05) < 0.01) & (p[:, 1] > 0) & (p[:, 1] < 0.08)
        return (plate | column) & (np.abs(p[:, 2]) < 0.03)

    hull = hull_where(inside, [-0.07, -0.02, -0.04], [0.07, 0.1, 0.04], SPACING)
    field = signless(hull, np.tile([0.0, 1.0, 0.0], (*hull.grid.shape, 1)))
    centres = all_centres(hull)
    shaved = hull.hair & (centres[..., 0] < 0.03)
    # At the scalp's samples hair comes out as fast as it ends.
    outer = shaved & (centres[..., 1] > 0.0)
    scalp = scalp_at(-0.008, half=0.058)
    long, short = (
        hair_flow(hull, one, scalp)[outer]
        for one in (field, field._replace(stubble=shaved))
    )
    assert np.median(long[:, 0]) > 0.6
    assert (short[:, 1] > 0.8).mean() > 0.95


def test_hair_on_a_cap_parts_where_both_ways_out_are_alike():
    # Hair over a roof that hangs down on both sides.
    def inside(p):
        plate = (np.abs(p[:, 1]) < 0.008) & (np.abs(p[:, 0]) < 0.06)
        curtain = (np.abs(np.abs(p[:, 0]) - 0.052) < 0.008) & (p[:, 1] < 0)
        return (plate | curtain & (p[:, 1] > -0.12)) & (np.abs(p[:, 2]) < 0.03)

    hull = hull_where(inside, [-0.07, -0.13, -0.04], [0.07, 0.02, 0.04], SPACING)
    centres = all_centres(hull)
    hangs = (np.abs(centres[..., 0]) > 0.044) & (centres[..., 1] < -0.004)
    along = np.where(hangs[..., None], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0])
    flow = hair_flow(hull, signless(hull, along), scalp_at(-0.008, half=0.04))
    lies = hull.hair & ~hangs & (np.abs(centres[..., 0]) > 0.008)
    outward = flow[lies][:, 0] * np.sign(centres[lies][:, 0])
    assert (outward[np.abs(centres[lies][:, 0]) < 0.044] > 0).all()


@pytest.mark.parametrize("seed", [0, 1])
def test_the_potential_gives_on_what_it_gets(seed):
    rng = np.random.default_rng(seed)
    first, second = np.triu_indices(12, 1)
    weight = rng.uniform(0.0, 1.0, len(first))
    links = Links(first, second, weight, np.zeros((len(first), 3)))
    takes, gives = rng.uniform(0.01, 0.1, 12), rng.uniform(0.0, 1.0, 12)
    found = solve_potential(links, takes, gives)
    dense = np.diag(takes)
    for i, j, w in zip(first, second, weight, strict=True):
        dense[[i, j], [i, j]] += w
        dense[[i, j], [j, i]] -= w
    assert np.allclose(dense @ found, gives, atol=1e-3)
    assert np.isclose((takes * found).sum(), gives.sum(), rtol=1e-3)


def test_lines_turn_the_flow_and_send_no_strand_aside(monkeypatch):
    # Hair in all directions, so that lines and flow often differ.
    hull = hull_where(
        lambda p: np.linalg.norm(p * [1.0, 2.0, 1.0], axis=1) < 0.06,
        [-0.07, -0.04, -0.07],
        [0.07, 0.04, 0.07],
        SPACING,
    )
    rng = np.random.default_rng(7)
    field = signless(hull, rng.normal(size=(*hull.grid.shape, 3)))
    scalp = scalp_at(-0.02, half=0.04)
    flow = hair_flow(hull, field, scalp)[hull.hair]
    monkeypatch.setattr("hairfit.fit.flow.LINES_COUNT", 0.0)
    alone = hair_flow(hull, field, scalp)[hull.hair]
    direction = field.direction[hull.hair]
    along, before = ((x * direction).sum(axis=1) for x in (flow, alone))
    across = flow - along[:, None] * direction
    assert np.allclose(across, alone - before[:, None] * direction, atol=1e-6)
    assert np.allclose(np.abs(along), np.abs(before), atol=1e-6)
    turned = along * before < 0.0
    assert 0.0 < turned.mean() < 0.5


def around_a_head(top: float, side: float, bottom: float):
    """Return hair around a round head, so high on its crown, so wide, so far down."""

    def inside(p):
        size = np.full(p.shape, side)
        size[:, 1] = np.where(p[:, 1] > 0.0, top, bottom)
        outside = np.linalg.norm(p, axis=1) > 0.05
        return outside & (np.linalg.norm(p / size, axis=1) < 1.0)

    return hull_where(inside, [-0.11, -0.21, -0.11], [0.11] * 3, SPACING)


def scalp_of_a_round_head():
    out = np.random.default_rng(0).normal(size=(4000, 3))
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    return 0.05 * out, out


def test_hair_of_which_nothing_is_known_grows_out_and_falls():
    hull = around_a_head(0.1, 0.1, 0.1)
    scalp, _ = scalp_of_a_round_head()
    field = fallen(hull, scalp, STANDS)
    found = field.direction[hull.hair]
    place = hull.grid.centres(hull.hair)
    place /= np.linalg.norm(place, axis=1, keepdims=True)
    assert np.allclose(np.linalg.norm(found, axis=1), 1.0)
    level = np.abs(place[:, 1]) < 0.3
    assert np.mean((found * place).sum(axis=1)[level] > 0.5) > 0.9
    assert np.mean(found[level, 1]) < -0.2
    assert np.mean(found[place[:, 1] < -0.7, 1]) < -0.8
    assert ((field.anisotropy > 0.0) & (field.anisotropy < 1.0)).all()
    more = fallen(hull, scalp, HANGS).direction[hull.hair]
    assert np.mean(more[level, 1]) < np.mean(found[level, 1]) - 0.2


def test_hair_falls_unless_it_stands_on_the_crown_as_high_as_anywhere():
    scalp, out = scalp_of_a_round_head()
    ball = how_it_falls(around_a_head(0.1, 0.1, 0.1), scalp, out)
    between = how_it_falls(around_a_head(0.08, 0.09, 0.1), scalp, out)
    hanging = how_it_falls(around_a_head(0.07, 0.09, 0.2), scalp, out)
    assert ball == STANDS
    assert STANDS < between < HANGS
    assert hanging == HANGS
    # A scalp that has no crown tells nothing.
    below = out[:, 1] < 0.0
    crownless = scalp[below], out[below]
    assert how_it_falls(around_a_head(0.07, 0.09, 0.2), *crownless) == STANDS
