import dataclasses
import functools
import io
import json
import pathlib
import re
import zipfile

import equinox as eqx
import hypothesis
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import strategies as st

from hairfit.errors import InputError
from hairfit.io.tree import (
    CONFIDENCE,
    LOCKS,
    MAPS,
    TREE,
    WISPS,
    load_tree,
    round_tree,
    save_tree,
)
from hairfit.model.certainty import TreeConfidence
from hairfit.model.cylinder import GeneralizedCylinder
from hairfit.model.locks import Locks
from hairfit.model.maps import ScalpMaps
from hairfit.model.scalp import Scalp
from hairfit.model.tree import HairTree, ScalpContour
from hairfit.model.wisp import Wisps

SAMPLES = pathlib.Path(__file__).parent / "samples"


def make_tree(clusters=3, knots=5, seed=0):
    rng = np.random.default_rng(seed)

    def some(*shape):
        return jnp.asarray(rng.uniform(0.01, 1.0, shape).astype(np.float32))

    along = clusters, knots
    cylinder = (
        *(some(*along, 3), some(clusters, 3), some(*along), some(*along, 32)),
        *(some(*along, 2), some(*along), some(*along)),
    )
    contour = some(clusters, 2), some(clusters), some(clusters, 32)
    return HairTree(
        scalp=Scalp(some(13, 13, 3)),
        contour=jax.vmap(ScalpContour)(*contour),
        cylinder=jax.vmap(GeneralizedCylinder)(*cylinder),
        length_variation=some(clusters),
        parent=tuple(int(rng.integers(-1, i)) if i else -1 for i in range(clusters)),
    )


def with_details(tree, seed=0):
    """Return the tree with wisps, maps, confidence and locks."""
    rng = np.random.default_rng(seed)

    def some(*shape):
        return jnp.asarray(rng.uniform(0.0, 1.0, shape).astype(np.float32))

    knots = tree.cylinder.skeleton.shape[1]
    owner = jnp.asarray(rng.integers(0, tree.count, 7), jnp.int32)
    maps = ScalpMaps(some(4, 6), some(4, 6), some(4, 6), some(4, 6, 3), some(4, 6))
    wisps = Wisps(some(7, 2), owner, 0.01 * some(7, knots, 3))
    sure = TreeConfidence(some(tree.count), some(tree.count), some(tree.count))
    hand = jnp.asarray(rng.choice([-1.0, 1.0], tree.count).astype(np.float32))
    locks = Locks(6.0 * some(tree.count, knots), hand, 9.0 * some(tree.count))
    given = {"wisps": wisps, "maps": maps, "confidence": sure, "locks": locks}
    return dataclasses.replace(tree, **given)


def any_tree(test):
    """Run a test on trees of all kinds."""
    numbers = st.integers(1, 6), st.integers(4, 9), st.integers(0, 99), st.booleans()
    return hypothesis.settings(max_examples=10, deadline=None)(
        hypothesis.given(st.tuples(*numbers))(test)
    )


def make_any(what):
    *numbers, details = what
    return with_details(make_tree(*numbers)) if details else make_tree(*numbers)


@any_tree
def test_an_exact_tree_comes_back_as_it_was_saved(tmp_path_factory, what):
    tree = make_any(what)
    path = tmp_path_factory.mktemp("tree") / "a.hairtree"
    save_tree(path, tree, exact=True)
    again = load_tree(path)
    assert jax.tree.structure(again) == jax.tree.structure(tree)
    for mine, other in zip(jax.tree.leaves(tree), jax.tree.leaves(again), strict=True):
        assert other.dtype == mine.dtype and jnp.array_equal(mine, other)


@any_tree
def test_a_tree_comes_back_within_half_a_step(tmp_path_factory, what):
    tree = make_any(what)
    path = tmp_path_factory.mktemp("tree") / "a.hairtree"
    save_tree(path, tree)
    again = load_tree(path)
    assert jax.tree.structure(again) == jax.tree.structure(tree)
    assert jax.tree.all(jax.tree.map(jnp.array_equal, again, round_tree(tree)))
    reach = np.maximum(np.mean(again.cylinder.radius, axis=1), 0.0004)
    for name, entry in {**TREE, **WISPS, **MAPS, **CONFIDENCE, **LOCKS}.items():
        optional = name.split("/")[0] in ("wisps", "maps", "confidence", "locks")
        if optional and tree.wisps is None:
            continue
        mine, other = (
            np.asarray(functools.reduce(getattr, name.split("/"), one), np.float64)
            for one in (tree, again)
        )
        most = np.full(mine.shape, 0.5 * entry.step)
        if entry.given == "reach":
            most = most / reach.reshape(-1, *[1] * (mine.ndim - 1))
        assert (np.abs(mine - other) <= most * 1.001 + 1e-7).all(), name
    before = path.read_bytes()
    save_tree(path, again)  # what was read is not rounded once more
    assert path.read_bytes() == before


@pytest.mark.parametrize("version", [1, 2])
def test_a_tree_of_an_old_version_is_read_for_ever(version):
    tree = load_tree(SAMPLES / f"version{version}.hairtree")
    want = make_tree(3, 5) if version == 1 else with_details(make_tree(3, 5))
    want = dataclasses.replace(want, confidence=None, locks=None)  # neither had them
    assert tree.parent == want.parent
    assert (tree.wisps is None) == (version == 1)
    closest = 0.0 if version == 1 else 0.02  # thin clusters have coarse scales
    for mine, other in zip(jax.tree.leaves(want), jax.tree.leaves(tree), strict=True):
        assert jnp.allclose(mine, other, rtol=0.0, atol=closest)


def test_version_1_holds_what_numpy_finds_in_its_zip():
    path = SAMPLES / "version1.hairtree"
    tree = load_tree(path)
    with zipfile.ZipFile(path) as archive:
        skeleton = np.load(io.BytesIO(archive.read("cylinder/skeleton.npy")))
    assert np.array_equal(tree.cylinder.skeleton, skeleton)


def test_the_documentation_is_enough_to_read_a_skeleton():
    with zipfile.ZipFile(SAMPLES / "version2.hairtree") as archive:
        planes = np.load(io.BytesIO(archive.read("cylinder/skeleton.npy")))
    folded = sum(int(256**i) * plane.astype(int) for i, plane in enumerate(planes))
    whole = np.where(folded % 2 == 0, folded // 2, -(folded + 1) // 2)
    skeleton = 5e-5 * np.cumsum(np.cumsum(whole, axis=1), axis=1)
    tree = load_tree(SAMPLES / "version2.hairtree")
    assert np.allclose(tree.cylinder.skeleton, skeleton, rtol=1e-6, atol=1e-9)


def test_a_thousand_clusters_take_at_most_200_kb(tmp_path):
    # Wisps 1 to 5 mm wide that leave a scalp at random and bend as hair does.
    rng = np.random.default_rng(0)
    count, knots = 1000, 16
    tree = make_tree(count, knots)
    radius = rng.uniform(0.001, 0.005, count)[:, None] * np.ones(knots)
    shape = rng.normal(size=(count, 32)).cumsum(axis=1) * 0.03
    contour = jax.vmap(ScalpContour)(
        jnp.asarray(rng.uniform(size=(count, 2)), jnp.float32),
        jnp.asarray(radius[:, 0] / 0.25, jnp.float32),
        jnp.asarray(shape * radius[:, :1] / 0.25, jnp.float32),
    )
    bend = rng.normal(size=(count, knots, 3)).cumsum(axis=1).cumsum(axis=1)
    map_ = 1.0 + 0.03 * rng.normal(size=(count, knots, 2)).cumsum(axis=1)
    turn = 0.03 * rng.normal(size=(2, count, knots)).cumsum(axis=2)
    normal = rng.normal(size=(count, 3))
    cylinder = (
        0.015 * np.arange(knots)[None, :, None] + 0.001 * bend,
        normal / np.linalg.norm(normal, axis=1, keepdims=True),
        radius,
        shape[:, None, :] * radius[..., None],
        map_,
        *turn,
    )
    single = (jnp.asarray(one, jnp.float32) for one in cylinder)
    tree = dataclasses.replace(
        tree, contour=contour, cylinder=jax.vmap(GeneralizedCylinder)(*single)
    )
    save_tree(tmp_path / "a.hairtree", tree)
    assert (tmp_path / "a.hairtree").stat().st_size <= 200_000
    # In memory: "4KB per each GC" [Kim02, section 4.9].
    held = sum(leaf.nbytes for leaf in jax.tree.leaves((tree.contour, tree.cylinder)))
    assert held / count <= 4096


@pytest.mark.parametrize("exact", [True, False])
def test_a_tree_with_numbers_that_are_not_finite_is_not_saved(tmp_path, exact):
    tree = make_tree()
    twist = tree.cylinder.twist.at[0, 0].set(jnp.nan)
    tree = eqx.tree_at(lambda t: t.cylinder.twist, tree, twist)
    with pytest.raises(InputError, match="`cylinder/twist` holds numbers that are not"):
        save_tree(tmp_path / "a.hairtree", tree, exact=exact)
    assert not list(tmp_path.iterdir())


def test_a_tree_beyond_all_heads_is_not_saved(tmp_path):
    tree = make_tree()
    far = tree.cylinder.skeleton.at[0, 0].set(1e9)
    tree = eqx.tree_at(lambda t: t.cylinder.skeleton, tree, far)
    with pytest.raises(InputError, match="far too large for hair"):
        save_tree(tmp_path / "a.hairtree", tree)


def test_the_same_tree_is_the_same_bytes(tmp_path):
    for name in "ab":
        save_tree(tmp_path / f"{name}.hairtree", make_tree())
    first, second = (tmp_path / f"{name}.hairtree" for name in "ab")
    assert first.read_bytes() == second.read_bytes()


def test_the_header_says_what_it_is(tmp_path):
    save_tree(tmp_path / "a.hairtree", make_tree(3, 5))
    with zipfile.ZipFile(tmp_path / "a.hairtree") as archive:
        header = json.loads(archive.read("header.json"))
        assert set(archive.namelist()) == {
            "header.json",
            *(f"{name}.npy" for name in TREE),
        }
    assert (
        header["format"] == "hairtree"
        and header["version"] == 2
        and header["encoding"] == "steps"
    )
    assert header["units"] == {"length": "metre", "angle": "radian"}
    assert header["clusters"] == 3 and header["knots"] == 5
    assert header["parent"] == list(make_tree(3, 5).parent)


def rewrite(folder, change=None, arrays=None, tree=None, exact=True):
    """Return a tree file whose header or arrays were changed."""
    path = folder / "a.hairtree"
    save_tree(path, tree or make_tree(), exact=exact)
    with zipfile.ZipFile(path) as archive:
        content = {name: archive.read(name) for name in archive.namelist()}
    header = json.loads(content["header.json"]) | (change or {})
    content["header.json"] = json.dumps(header).encode()
    for name, array in (arrays or {}).items():
        if array is None:
            del content[f"{name}.npy"]
            continue
        with (folder / "x.npy").open("wb") as file:
            np.save(file, array, allow_pickle=True)
        content[f"{name}.npy"] = (folder / "x.npy").read_bytes()
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in content.items():
            archive.writestr(name, data)
    return path


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"version": 3}, "of version 3, newer than 2, .* update hairfit"),
        ({"version": "x"}, "its version is 'x'"),
        ({"format": "zip"}, "is no .hairtree: its header says otherwise"),
        ({"parent": [-1, 1, 0]}, "its clusters do not form a tree"),
        ({"parent": [-1]}, "its clusters do not form a tree"),
        ({"parent": [-1, "a", 0]}, "its clusters do not form a tree"),
        ({"knots": 4}, r"`cylinder/skeleton` is float32 of shape \(3, 5, 3\), not"),
        ({"knots": None}, "its clusters do not form a tree"),
        ({"knots": -1}, "its clusters do not form a tree"),
        ({"encoding": "words"}, "its clusters do not form a tree"),
        ({"encoding": "steps"}, "`scalp/control` is float32 of shape .* not planes"),
        ({"wisps": 3}, r"is damaged or no \.hairtree"),
        ({"rows": 3}, r"is damaged or no \.hairtree"),
        ({"confidence": True}, r"is damaged or no \.hairtree"),
        ({"confidence": 1}, "its clusters do not form a tree"),
        ({"locks": True}, r"is damaged or no \.hairtree"),
        ({"locks": 1}, "its clusters do not form a tree"),
    ],
)
def test_a_header_that_does_not_fit_is_refused(tmp_path, change, message):
    with pytest.raises(InputError, match=message):
        load_tree(rewrite(tmp_path, change))


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (None, r"is damaged or no \.hairtree"),
        (np.zeros((3, 5)), "`cylinder/twist` is float64"),
        (np.zeros((2, 5), np.float32), r"of shape \(2, 5\), not"),
        (np.full((3, 5), np.nan, np.float32), "`cylinder/twist` holds numbers"),
        (np.array([{}], object), r"is damaged or no \.hairtree"),
    ],
)
def test_an_array_that_does_not_fit_is_refused(tmp_path, array, message):
    with pytest.raises(InputError, match=message):
        load_tree(rewrite(tmp_path, arrays={"cylinder/twist": array}))


@pytest.mark.parametrize(
    "planes", [np.zeros((1, 2, 5), np.uint8), np.zeros((9, 3, 5), np.uint8)]
)
def test_planes_that_do_not_fit_are_refused(tmp_path, planes):
    path = rewrite(tmp_path, arrays={"cylinder/twist": planes}, exact=False)
    with pytest.raises(InputError, match="`cylinder/twist` is uint8 of shape"):
        load_tree(path)


def test_a_wisp_of_no_cluster_is_refused(tmp_path):
    owner = np.full(7, 3.0, np.float32)
    path = rewrite(
        tmp_path, arrays={"wisps/owner": owner}, tree=with_details(make_tree())
    )
    with pytest.raises(InputError, match=r"is damaged or no \.hairtree"):
        load_tree(path)


@pytest.mark.parametrize("exact", [True, False])
def test_a_damaged_file_is_refused_wherever_it_breaks(tmp_path, exact):
    path = tmp_path / "a.hairtree"
    tree = make_tree(1, 4)
    tree = tree if exact else round_tree(tree)
    save_tree(path, tree, exact=exact)
    whole, refused = path.read_bytes(), 0
    for cut in range(0, len(whole), 211):
        path.write_bytes(whole[:cut])
        with pytest.raises(InputError, match=r"is damaged or no \.hairtree"):
            load_tree(path)
    for place in range(40, min(4000, len(whole)), 61):
        changed = bytearray(whole)
        changed[place] ^= 0xFF
        path.write_bytes(changed)
        try:  # a zip file says some things twice: a few bytes do not matter
            assert jax.tree.all(jax.tree.map(jnp.array_equal, load_tree(path), tree))
        except InputError as error:
            assert re.match(r"'.*a\.hairtree' is", str(error))
            refused += 1
    assert refused > 30


def test_what_is_no_tree_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"is not a tree; give a \.hairtree file"):
        load_tree(tmp_path / "a.hair")
    with pytest.raises(InputError, match=r"there is no '.*a\.hairtree'"):
        load_tree(tmp_path / "a.hairtree")
    with pytest.raises(InputError, match=r"saved as \.hairtree, not as 'a\.npz'"):
        save_tree(tmp_path / "a.npz", make_tree())
