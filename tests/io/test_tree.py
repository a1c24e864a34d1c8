import json
import zipfile

import hypothesis
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import strategies as st

from hairfit.errors import InputError
from hairfit.io.tree import ARRAYS, load_tree, save_tree
from hairfit.model.cylinder import GeneralizedCylinder
from hairfit.model.scalp import Scalp
from hairfit.model.tree import HairTree, ScalpContour


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


@hypothesis.given(st.integers(1, 6), st.integers(4, 9), st.integers(0, 99))
@hypothesis.settings(max_examples=10, deadline=None)
def test_a_tree_comes_back_as_it_was_saved(tmp_path_factory, clusters, knots, seed):
    path = tmp_path_factory.mktemp("tree") / "a.hairtree"
    tree = make_tree(clusters, knots, seed)
    save_tree(path, tree)
    again = load_tree(path)
    assert jax.tree.structure(again) == jax.tree.structure(tree)
    for mine, other in zip(jax.tree.leaves(tree), jax.tree.leaves(again), strict=True):
        assert other.dtype == jnp.float32 and jnp.array_equal(mine, other)


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
            *(f"{name}.npy" for name in ARRAYS),
        }
    assert header["format"] == "hairtree" and header["version"] == 1
    assert header["units"] == {"length": "metre", "angle": "radian"}
    assert header["clusters"] == 3 and header["knots"] == 5
    assert header["parent"] == list(make_tree(3, 5).parent)


def rewrite(folder, change=None, arrays=None):
    """Return a tree file whose header or arrays were changed."""
    path = folder / "a.hairtree"
    save_tree(path, make_tree())
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
        ({"version": 2}, "of version 2, newer than 1, .* update hairfit"),
        ({"version": "x"}, "its version is 'x'"),
        ({"format": "zip"}, "is no .hairtree: its header says otherwise"),
        ({"parent": [-1, 1, 0]}, "its clusters do not form a tree"),
        ({"parent": [-1]}, "its clusters do not form a tree"),
        ({"parent": [-1, "a", 0]}, "its clusters do not form a tree"),
        ({"knots": 4}, r"`cylinder/skeleton` is float32 of shape \(3, 5, 3\), not"),
        ({"knots": None}, "its clusters do not form a tree"),
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


def test_a_damaged_file_is_refused_wherever_it_breaks(tmp_path):
    path = tmp_path / "a.hairtree"
    save_tree(path, make_tree(1, 4))
    whole = path.read_bytes()
    for cut in range(0, len(whole), 211):
        path.write_bytes(whole[:cut])
        with pytest.raises(InputError, match=r"is damaged or no \.hairtree"):
            load_tree(path)
    for place in range(40, 4000, 97):
        changed = bytearray(whole)
        changed[place] ^= 0xFF
        path.write_bytes(changed)
        with pytest.raises(InputError, match=r"'.*a\.hairtree' is"):
            load_tree(path)


def test_what_is_no_tree_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"is not a tree; give a \.hairtree file"):
        load_tree(tmp_path / "a.hair")
    with pytest.raises(InputError, match=r"there is no '.*a\.hairtree'"):
        load_tree(tmp_path / "a.hairtree")
    with pytest.raises(InputError, match=r"saved as \.hairtree, not as 'a\.npz'"):
        save_tree(tmp_path / "a.npz", make_tree())
