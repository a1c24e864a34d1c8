import dataclasses

import jax
import numpy as np
import pytest

from hairfit import InputError
from hairfit.model import leaves, levels
from hairfit.synthetic import STYLES, Scene, head_distance, make_head, make_scalp
from hairfit.synthetic.guides import TIE
from hairfit.synthetic.scene import scene_strands
from hairfit.synthetic.styles import make_style, upper_and_turn
from hairfit.synthetic.tiling import scatter, tile_contours

SCENE = Scene(strands=1500, points=50)


@pytest.fixture(scope="module")
def scalp():
    return make_scalp(make_head())


QUICK = ("straight", "wavy")
PARAMS = [
    name if name in QUICK else pytest.param(name, marks=pytest.mark.slow)
    for name in STYLES
]


@pytest.fixture(scope="module", params=PARAMS)
def style(request, scalp):
    tree = make_style(request.param, 0, scalp)
    return request.param, tree, scene_strands(tree, SCENE)


def turning(points):
    """Return the angle that each strand turns by in total."""
    step = np.diff(points, axis=1)
    step /= np.linalg.norm(step, axis=2, keepdims=True)
    cosine = np.einsum("ijk,ijk->ij", step[:, 1:], step[:, :-1])
    return np.arccos(np.clip(cosine, -1.0, 1.0)).sum(1)


def test_a_style_has_two_levels_and_covers_the_scalp(style):
    _, tree, points = style
    roots, wisps = levels(tree)
    assert 24 <= len(roots) <= 40
    assert 4 * len(roots) <= len(wisps) <= 6 * len(roots)
    assert set(leaves(tree)) == set(wisps)
    assert points.shape == (1500, 50, 3)
    assert np.isfinite(points).all()


def test_no_strand_enters_the_head_and_all_start_on_it(style):
    _, _, points = style
    distance = head_distance(points)
    assert distance.min() > -1e-3
    assert np.abs(distance[:, 0]).max() < 3.5e-3


def test_hair_has_a_haircuts_length(style):
    _, _, points = style
    length = np.linalg.norm(np.diff(points, axis=1), axis=2).sum(1)
    assert length.min() > 0.07 and length.max() < 0.5
    assert 0.15 < np.median(length) < 0.32


def test_each_style_is_what_its_name_says(style):
    name, _, points = style
    turns = np.median(turning(points)) / (2 * np.pi)
    low, high = {
        "straight": (0.1, 0.8),
        "wavy": (1.0, 3.5),
        "curly": (3.5, 9.0),
        "ponytail": (0.1, 1.2),
    }[name]
    assert low < turns < high
    to_tie = np.linalg.norm(points - TIE, axis=2).min(1)
    assert (to_tie.max() < 0.03) == (name == "ponytail")


def test_the_same_seed_gives_the_same_tree_and_another_seed_another(style, scalp):
    name, tree, _ = style
    if name != "straight":
        return
    pairs = zip(
        jax.tree.leaves(tree), jax.tree.leaves(make_style(name, 0, scalp)), strict=True
    )
    assert all(np.array_equal(one, two) for one, two in pairs)
    other = make_style(name, 1, scalp)
    assert not np.allclose(tree.contour.centre[:9], other.contour.centre[:9])


def test_an_unknown_style_is_refused(scalp):
    with pytest.raises(InputError, match="no style 'mohawk'; take one of straight"):
        make_style("mohawk", 0, scalp)


def test_a_linear_map_is_scales_and_shear_after_a_twist(style):
    _, tree, _ = style
    rng = np.random.default_rng(0)
    count, knots = tree.cylinder.twist.shape
    maps = rng.normal(size=(count, knots, 2, 2))
    maps[np.linalg.det(maps) < 0] *= [[-1.0], [1.0]]
    with jax.enable_x64(True):
        found = upper_and_turn(tree.cylinder, maps)
        twist = np.asarray(found.twist)
        cos, sin = np.cos(twist), np.sin(twist)
        turn = np.stack([np.stack([cos, -sin], -1), np.stack([sin, cos], -1)], -2)
        upper = np.zeros_like(maps)
        upper[..., 0, 0], upper[..., 0, 1] = found.scale[..., 0], found.shear
        upper[..., 1, 1] = found.scale[..., 1]
    assert np.allclose(upper @ turn, maps)


def test_scattered_points_are_even():
    rng = np.random.default_rng(0)
    p = rng.uniform(0, 1, (2000, 3)) * [1, 1, 0]
    chosen = p[scatter(p, 25, rng)]
    apart = np.linalg.norm(chosen[:, None] - chosen[None], axis=2) + 9 * np.eye(25)
    assert apart.min(1).min() > 0.1  # a perfect grid has 0.2


def test_contours_reach_past_the_middle_between_neighbours():
    contour = tile_contours(np.array([[0.25, 0.5], [0.75, 0.5]]))
    reach = np.asarray(contour.radius[:, None] + contour.offset)
    assert np.allclose(reach[0, 0], 1.12 * 0.25, atol=1e-6)  # towards the neighbour
    assert np.allclose(reach[0, 16], 1.12 * 0.25, atol=1e-6)  # towards the border
    assert np.allclose(reach[0, 8], 1.12 * 0.5, atol=1e-6)


def test_a_scene_that_cannot_be_is_refused():
    for name in ("views", "strands", "points"):
        with pytest.raises(InputError, match=f"`{name}` of a synthetic capture must"):
            dataclasses.replace(SCENE, **{name: 0})
    with pytest.raises(InputError, match="at least 16 pixels"):
        dataclasses.replace(SCENE, size=(8, 100))
