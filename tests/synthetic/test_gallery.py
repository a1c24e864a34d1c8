"""The gallery: what every style must be, and what makes each one what it is."""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hairfit import InputError
from hairfit.model import HairTree, find_owner, leaves, sample_roots, scalp_point
from hairfit.model.strand import sample_hair
from hairfit.synthetic.gallery import GALLERY, make_gallery_tree, make_subject
from hairfit.synthetic.gallery.tied import SIDE_TIE
from hairfit.synthetic.guides import TIE
from hairfit.synthetic.head import head_distance

STRANDS, POINTS = 1500, 49


class Grown(NamedTuple):
    """Strands of a style, and the leaf that owns each."""

    strands: np.ndarray
    owner: np.ndarray


@functools.cache
def styled(name: str) -> HairTree:
    return make_gallery_tree(name)


@functools.cache
def hair_of(name: str) -> Grown:
    hair = sample_hair(styled(name), STRANDS, POINTS, jax.random.key(5))
    return Grown(np.asarray(hair.strands), np.asarray(hair.owner))


def lengths(strands: np.ndarray) -> np.ndarray:
    return np.linalg.norm(np.diff(strands, axis=1), axis=2).sum(1)


def roots(hair: Grown) -> np.ndarray:
    return hair.strands[:, 0]


def check_style(name: str) -> None:
    """Assert what holds for all styles."""
    tree, hair = styled(name), hair_of(name)
    on_scalp = jax.jit(jax.vmap(scalp_point, (None, 0)))
    rooted = on_scalp(tree.scalp, tree.contour.centre)
    apart = np.linalg.norm(tree.cylinder.skeleton[:, 0] - rooted, axis=1)
    assert apart.max() < 1e-4
    assert 20 <= tree.parent.count(-1) <= 80
    assert len(leaves(tree)) <= 600
    uv = sample_roots(tree.scalp, 2000, jax.random.key(7))
    assert np.mean(np.asarray(find_owner(tree, uv)) >= 0) > 0.97
    assert hair.strands.shape == (STRANDS, POINTS, 3)
    assert set(hair.owner.tolist()) <= set(leaves(tree).tolist())
    assert np.isfinite(hair.strands).all()
    assert np.mean(head_distance(hair.strands) < -0.002) < 0.01
    assert lengths(hair.strands).max() < 1.0
    # No spikes: no strand turns back on itself from one piece to the next.
    step = np.diff(hair.strands, axis=1)
    size = np.linalg.norm(step, axis=2)
    back = (step[:, 1:] * step[:, :-1]).sum(2) < -0.5 * size[:, 1:] * size[:, :-1]
    assert back.mean() < 0.01


def face_share(name: str, strands: np.ndarray) -> float:
    """Return the share of points in front of the face, from the eyes to the mouth."""
    p = strands.reshape(-1, 3)
    before = (p[:, 2] > 0.06) & (np.abs(p[:, 0]) < 0.035)
    return float(np.mean(before & (p[:, 1] < 0.015) & (p[:, 1] > -0.08)))


def test_the_gallery_has_the_styles_that_were_asked_for():
    wanted = {"bob", "long-straight", "long-wavy", "tight-curls", "afro", "pixie"}
    wanted |= {"undercut", "ponytail", "braid", "bun", "fringe", "parted"}
    assert wanted <= set(GALLERY)
    assert len(GALLERY) == len(set(GALLERY)) >= 14


def test_an_unknown_style_is_refused_with_the_names_there_are():
    with pytest.raises(
        InputError, match="no style 'mullet'; take one of long-str.*bun"
    ):
        make_gallery_tree("mullet")


def test_a_buzz_cut_is_short_everywhere_and_covers_the_scalp():
    check_style("buzz-cut")
    # Near the patch's corners, where (u, v) is far from even, a few come out longer.
    assert np.quantile(lengths(hair_of("buzz-cut").strands), 0.95) < 0.020


def test_the_same_seed_gives_the_same_tree_and_another_one_another_tree():
    once, again = styled("buzz-cut"), make_gallery_tree("buzz-cut", 0, make_subject())
    assert all(
        jnp.array_equal(a, b)
        for a, b in zip(jax.tree.leaves(once), jax.tree.leaves(again), strict=True)
    )
    other = make_gallery_tree("buzz-cut", 1)
    assert once.contour.centre.dtype == jnp.float32
    assert not np.allclose(once.contour.centre[:30], other.contour.centre[:30])


@pytest.mark.slow
@pytest.mark.parametrize("name", GALLERY)
def test_each_style_is_a_sound_tree_whose_hair_stays_out_of_the_head(name):
    check_style(name)
    assert face_share(name, hair_of(name).strands) < 0.002


@pytest.mark.slow
def test_tips_of_a_bob_lie_at_one_height():
    hair = hair_of("bob")
    loose = roots(hair)[:, 1] > 0.0
    tips = hair.strands[loose, -1, 1]
    assert np.std(tips) < 0.008
    long = hair_of("long-straight")
    assert np.mean(tips) > np.mean(long.strands[:, -1, 1]) + 0.08


@pytest.mark.slow
def test_waves_and_curls_bend_more_than_straight_hair():
    def bending(name):
        step = np.diff(hair_of(name).strands, axis=1)
        way = step / np.linalg.norm(step, axis=2, keepdims=True)
        turn = np.arccos(np.clip((way[:, 1:] * way[:, :-1]).sum(2), -1.0, 1.0))
        return np.median(turn.sum(1) / lengths(hair_of(name).strands))

    straight, wavy, curly = map(bending, ("long-straight", "long-wavy", "tight-curls"))
    assert wavy > 2.0 * straight
    assert curly > 2.0 * wavy


@pytest.mark.slow
def test_a_fringe_covers_the_forehead_and_ends_above_the_eyes():
    def covered(name):
        p = hair_of(name).strands.reshape(-1, 3)
        front = p[(p[:, 2] > 0.06) & (p[:, 1] > 0.035) & (p[:, 1] < 0.06)]
        return np.histogram(front[:, 0], np.linspace(-0.04, 0.04, 9))[0]

    assert covered("fringe").min() > 10
    assert covered("long-straight")[2:-2].max() == 0
    fringe = hair_of("fringe").strands
    tips = fringe[:, -1]
    over = (tips[:, 2] > 0.07) & (np.abs(tips[:, 0]) < 0.03)
    assert over.sum() > 30
    assert tips[over, 1].min() > 0.02


@pytest.mark.slow
def test_no_strand_of_one_side_of_a_parting_crosses_to_the_other():
    hair = hair_of("parted")
    x, z = roots(hair)[:, 0], roots(hair)[:, 2]
    front = z > 0.0
    left, right = front & (x > 0.036), front & (x < 0.032)
    assert min(left.sum(), right.sum()) > 50
    near = hair.strands[:, :20]
    assert np.mean(near[left, :, 0].min(1) > 0.028) > 0.98
    assert np.mean(near[right, :, 0].max(1) < 0.040) > 0.98


@pytest.mark.slow
def test_sides_of_an_undercut_are_much_shorter_than_its_top():
    hair = hair_of("undercut")
    p, length = roots(hair), lengths(hair_of("undercut").strands)
    side = (np.abs(p[:, 0]) > 0.06) & (p[:, 1] < 0.05)
    top = (np.abs(p[:, 0]) < 0.02) & (p[:, 1] > 0.10)
    assert min(side.sum(), top.sum()) > 30
    assert np.quantile(length[side], 0.9) < 0.020
    assert np.median(length[top]) > 0.10


@pytest.mark.slow
def test_a_mohawk_stands_in_the_middle_and_is_shaved_beside_it():
    hair = hair_of("mohawk")
    length, x = lengths(hair.strands), np.abs(roots(hair)[:, 0])
    assert np.quantile(length[x > 0.03], 0.9) < 0.020
    assert np.median(length[x < 0.015]) > 0.08


@pytest.mark.slow
@pytest.mark.parametrize(("name", "tie"), [("ponytail", TIE), ("pigtails", SIDE_TIE)])
def test_tied_hair_passes_its_tie(name, tie):
    strands = hair_of(name).strands.copy()
    if name == "pigtails":
        strands[strands[:, 0, 0] < 0.0] *= [-1.0, 1.0, 1.0]
    nearest = np.linalg.norm(strands - tie, axis=2).min(1)
    assert np.quantile(nearest, 0.99) < 0.03
    assert strands[:, -1, 1].max() < tie[1]


@pytest.mark.slow
def test_the_right_pigtail_is_the_mirror_image_of_the_left():
    skeleton = np.asarray(styled("pigtails").cylinder.skeleton)
    left, right = (skeleton[sign * skeleton[:, 0, 0] > 0.0] for sign in (1.0, -1.0))
    assert len(left) == len(right)
    tips = np.sort(left[:, -1, 1]) - np.sort(right[:, -1, 1])
    assert np.abs(tips).max() < 1e-3


@pytest.mark.slow
def test_a_bun_ends_in_a_ball_and_a_braid_hangs_down_the_back():
    bun = hair_of("bun").strands[:, -10:]
    middle = np.median(bun.reshape(-1, 3), axis=0)
    assert np.linalg.norm(bun - middle, axis=2).max() < 0.06
    assert middle[2] < -0.11
    braid = hair_of("braid").strands[:, -1]
    assert np.abs(braid[:, 0]).max() < 0.035
    assert braid[:, 1].max() < -0.15


@pytest.mark.slow
def test_an_afro_is_round_and_a_pixie_is_short():
    tips = hair_of("afro").strands[:, -1] - np.array([0.0, 0.040, -0.018])
    radius = np.linalg.norm(tips, axis=1)
    assert np.std(radius) < 0.1 * np.mean(radius)
    assert np.mean(radius) > 0.13
    assert lengths(hair_of("pixie").strands).max() < 0.12
