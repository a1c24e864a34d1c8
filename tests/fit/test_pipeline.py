import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hairfit.capture import Capture, load_capture
from hairfit.capture.distance import signed_distance
from hairfit.errors import InputError
from hairfit.evaluate.curls import find_curls
from hairfit.fit import FitConfig, fit_capture, pipeline
from hairfit.fit.branches import ROUNDS
from hairfit.fit.curls import Curls
from hairfit.fit.derive import derive_strands
from hairfit.fit.grow import AT_ONCE
from hairfit.fit.pipeline import STRAND_POINTS
from hairfit.fit.presets import PRESETS, Preset
from hairfit.fit.refine import RefineConfig
from hairfit.model.tree import leaves, levels
from hairfit.render import mesh_depth, rasterise
from hairfit.synthetic.head import make_head, make_scalp
from hairfit.synthetic.picture import Look
from hairfit.synthetic.scene import Scene, write_capture
from hairfit.synthetic.styles import make_style

CONFIG = FitConfig("draft", seed=3, strands=400)
COARSE = Preset(0.008, 600, 3, 30, 8, RefineConfig(1, 6, 300, 12))


@pytest.fixture(scope="module", autouse=True)
def draft():
    """Make a draft as coarse as the pictures are."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(PRESETS, "draft", COARSE)
        yield


@pytest.fixture(scope="module")
def capture(tmp_path_factory) -> Capture:
    """Known straight hair, photographed small."""
    folder = tmp_path_factory.mktemp("capture") / "straight"
    head = make_head()
    tree = make_style("straight", 0, make_scalp(head))
    write_capture(tree, head, folder, Scene(6, (144, 192), strands=1500, points=24))
    return load_capture(folder)


@pytest.fixture(scope="module")
def fitted(capture):
    """What a fit without interruption finds, and what it says on the way."""
    said = []
    result = fit_capture(capture, CONFIG, progress=lambda *step: said.append(step))
    return result, said


def bytes_of(result):
    arrays = [*jax.tree.leaves(result.tree), result.strands.points]
    return [np.asarray(x).tobytes() for x in arrays], result.tree.parent


def strands_of(result):
    return result.strands.points.reshape(result.strands.count, -1, 3)


@pytest.mark.slow
def test_strands_are_rooted_on_the_scalp_and_run_outside_the_head(fitted, capture):
    result, _ = fitted
    points = strands_of(result).astype(np.float64)
    assert len(points) == CONFIG.strands
    assert np.abs(signed_distance(capture.head, points[:, 0])).max() < 0.002
    depth = -signed_distance(capture.head, points.reshape(-1, 3))
    assert depth.max() < 0.001
    lengths = np.linalg.norm(np.diff(points, axis=1), axis=2).sum(axis=1)
    assert 0.1 < np.median(lengths) < 0.4  # the truth has 0.26


@pytest.mark.slow
def test_the_tree_has_its_levels_and_its_figures_are_right(fitted):
    result, _ = fitted
    tree, figures = result.tree, result.figures
    parent = np.asarray(tree.parent)
    assert figures["levels"] == len(levels(tree)) == COARSE.levels
    assert figures["root_clusters"] == (parent < 0).sum() >= 2
    assert figures["leaf_clusters"] == len(leaves(tree)) <= COARSE.leaves
    assert figures["voxel_mm"] >= 8.0
    assert figures["grown_strands"] <= COARSE.guides
    assert 0 < figures["branches"] <= ROUNDS * AT_ONCE
    points = strands_of(result)
    lengths = np.linalg.norm(np.diff(points, axis=1), axis=2).sum(axis=1)
    assert np.isclose(figures["median_length_mm"], 1e3 * np.median(lengths), rtol=1e-5)
    assert all(np.isfinite(np.asarray(x)).all() for x in jax.tree.leaves(tree))


@pytest.mark.slow
def test_hair_that_hardly_grows_is_refused_before_it_branches(capture, monkeypatch):
    monkeypatch.setattr(pipeline, "FEWEST_GROWN", COARSE.guides + 1)
    monkeypatch.setattr(pipeline, "with_branches", None)
    with pytest.raises(
        InputError, match=r"only \d+ of 600 strands grew from the scalp"
    ):
        fit_capture(capture, CONFIG)


@pytest.mark.slow
def test_the_tree_says_how_sure_its_clusters_are(fitted):
    result, _ = fitted
    known = result.tree.confidence
    assert known is not None
    assert known.photographed.shape == (result.tree.count,)
    photographed = np.asarray(known.photographed)
    assert 0.0 <= photographed.min() < 0.1 < photographed.max() < 1.0
    assert 1e-4 < known.sigma_position.min() <= known.sigma_position.max() < 0.03
    assert 0.01 < known.sigma_angle.min() <= known.sigma_angle.max() < 1.5


@pytest.mark.slow
def test_the_tree_has_the_colour_of_the_hair(fitted, capture):
    result, _ = fitted
    looks, maps = result.looks, result.tree.maps
    assert looks is not None and maps is not None
    assert np.allclose(maps.colour, np.array(looks.colour), atol=2.0**-12)
    assert looks.exposure.shape == (len(capture.views),)
    # How bright it is, photographs do not say. Highlights are no part of the colour.
    colour, true = np.array(looks.colour), np.array(Look().hair)
    assert np.allclose(colour / colour.sum(), true / true.sum(), atol=0.03)


def mute(maps):
    return [dataclasses.replace(m, confidence=0.0 * m.confidence) for m in maps]


@pytest.mark.slow
def test_strands_of_curly_hair_curl(fitted, capture, monkeypatch):
    straight, _ = fitted
    assert straight.figures["curl_radius_mm"] == 0.0
    assert straight.figures["direction_seen"]
    assert straight.tree.maps is not None and not straight.tree.maps.curl.any()
    # Nor do its photographs say which way it runs.
    monkeypatch.setattr(
        pipeline,
        "see_curls",
        lambda _, views, maps, *__: Curls(0.004, 0.024, mute(maps), False),
    )
    result = fit_capture(capture, CONFIG)
    assert result.figures["curl_radius_mm"] == 4.0
    assert result.figures["curl_pitch_mm"] == 24.0
    assert not result.figures["direction_seen"]
    maps = result.tree.maps
    assert maps is not None and np.allclose(maps.curl, 0.004, atol=1e-5)
    assert result.strands.points.shape[0] > straight.strands.points.shape[0]
    curls = find_curls(result.strands)
    assert curls.curled.mean() > 0.9
    assert np.median(curls.radius[curls.curled]) == pytest.approx(0.004, rel=0.15)


@pytest.fixture
def waves(monkeypatch):
    """Let photographs show waves of 40 mm, 4 mm high."""
    monkeypatch.setattr(
        pipeline,
        "see_curls",
        lambda _, views, maps, *__: Curls(0.0, 0.0, list(maps), True, 0.04, 0.004),
    )


@pytest.mark.slow
@pytest.mark.usefixtures("waves")
def test_skeletons_of_wavy_hair_have_twice_the_knots(fitted, capture):
    said: list[str] = []
    result = fit_capture(
        capture, CONFIG, progress=lambda stage, share: said.append(stage)
    )
    assert "waving the hair" in said
    assert result.figures["wave_length_mm"] == 40.0
    assert result.figures["wave_height_mm"] == 4.0
    wavy, straight = result.tree, fitted[0].tree
    assert straight.cylinder.skeleton.shape[1] == COARSE.knots
    assert wavy.cylinder.skeleton.shape[1] == 2 * COARSE.knots


@pytest.mark.slow
def test_painted_colour_changes_no_strand(fitted, capture):
    result, _ = fitted
    grey = eqx.tree_at(lambda t: t.maps.colour, result.tree, replace_fn=jnp.ones_like)
    count = CONFIG.strands, STRAND_POINTS, CONFIG.seed
    for tree in (result.tree, grey):
        grown = derive_strands(tree, capture.head, *count)
        assert np.array_equal(grown.points, result.strands.points)


@pytest.mark.slow
def test_hair_lies_where_the_photographs_show_it(fitted, capture):
    result, _ = fitted
    covered = []
    for view in capture.views:
        depth = mesh_depth(capture.head, view.camera)
        points = strands_of(result).astype(np.float64)
        drawn = rasterise(points, view.camera, mesh_depth=depth, radius_px=2.0)
        both = (drawn.coverage & view.hair).sum()
        covered.append(both / (drawn.coverage | view.hair).sum())
    assert min(covered) > 0.6


@pytest.mark.slow
def test_progress_only_grows(fitted):
    _, said = fitted
    shares = [share for _, share in said]
    assert (np.diff(shares) >= 0).all()
    assert shares[0] == 0.0 and 0.9 < shares[-1] <= 1.0
    assert all(stage for stage, _ in said)


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bytes(fitted, capture):
    result, _ = fitted
    assert bytes_of(fit_capture(capture, CONFIG)) == bytes_of(result)


class Interruption(Exception):
    pass


@pytest.mark.slow
@pytest.mark.parametrize("stage", ["carving by direction", "refining the tree"])
def test_a_fit_that_is_taken_up_gives_the_same_bytes(fitted, capture, tmp_path, stage):
    result, said = fitted

    def interrupt(current, share):
        if current == stage:
            raise Interruption

    with pytest.raises(Interruption):
        fit_capture(capture, CONFIG, checkpoint=tmp_path, progress=interrupt)
    kept = {path.name for path in tmp_path.iterdir()}
    assert {f"orientation-{view.name}.npz" for view in capture.views} <= kept
    assert ("tree.hairtree" in kept) == (stage == "refining the tree")
    again = fit_capture(capture, CONFIG, checkpoint=tmp_path)
    assert bytes_of(again) == bytes_of(result)


@pytest.mark.slow
@pytest.mark.usefixtures("waves")
def test_a_fit_in_no_time_is_a_draft_without_refinement(capture):
    said: list[str] = []
    config = FitConfig("high", seed=3, strands=400, time_limit=1.0)
    result = fit_capture(
        capture, config, progress=lambda stage, share: said.append(stage)
    )
    assert result.figures["quality"] == "draft"
    assert said.count("refining the tree") == 1  # its start, no round
    assert "waving the hair" not in said
    points = result.strands.points
    assert len(points) and np.isfinite(points).all()


def test_without_a_head_there_is_no_fit(tmp_path):
    with pytest.raises(InputError, match="no `head.obj` in .*put the head's mesh"):
        fit_capture(Capture(tmp_path, ()), CONFIG)
