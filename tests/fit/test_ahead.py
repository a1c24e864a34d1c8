import dataclasses
import threading

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from ball_hair import HEIGHT, RADIUS, WIDTH, ball, comb, dome, photograph, ring
from refine_case import refine_case

from hairfit.evaluate.visibility import Sight
from hairfit.fit.ahead import (
    Shapes,
    compile_growth,
    compile_looks,
    compile_paths,
    compile_refinement,
    compile_strands,
    compiling_ahead,
)
from hairfit.fit.appearance import both_terms, find_appearance
from hairfit.fit.evidence import Field
from hairfit.fit.grid import Grid
from hairfit.fit.grow import grow as grow_paths
from hairfit.fit.grow import space_of, steps_on, trace
from hairfit.fit.hull import Hull
from hairfit.fit.refine import RefineConfig, descend, move, refine
from hairfit.fit.samples import grow_placed, place
from hairfit.model import sample_roots
from hairfit.model.scalp import area_up_to, normals_on, points_on, roots_in
from hairfit.model.strand import grow, sample_hair
from hairfit.render.lit import arriving, volume_of

CONFIG = RefineConfig(rounds=2, steps=2, strands=300, points=9)
KNOTS = 7


def programs(*functions):
    """Return how many programs each function was compiled to so far."""
    return [f._cache_size() for f in functions]  # pyright: ignore


def test_what_is_called_ahead_is_called_in_order_on_another_thread():
    said, here = [], threading.get_ident()

    def say(word):
        said.append((word, threading.get_ident() == here))

    with compiling_ahead() as ahead:
        ahead(say, "one")
        ahead(say, "two")
    assert said == [("one", False), ("two", False)]


def test_what_fails_ahead_is_not_lost():
    def fail():
        raise ValueError("no room")

    with pytest.raises(ValueError, match="no room"), compiling_ahead() as ahead:
        ahead(fail)


def test_what_waits_is_left_out_where_the_work_fails():
    begun, go, said = threading.Event(), threading.Event(), []

    def first():
        begun.set()
        go.wait(10)
        said.append("first")

    with pytest.raises(KeyError), compiling_ahead() as ahead:
        ahead(first)
        ahead(said.append, "second")
        begun.wait(10)
        threading.Timer(0.2, go.set).start()
        raise KeyError("no hair")
    assert said == ["first"]


def test_growing_compiles_nothing_anew():
    compile_growth(321, (123,))
    before = programs(area_up_to, roots_in, points_on, normals_on)
    for count in (321, 123):
        uv = sample_roots(dome(), count, jax.random.key(5))
    uv = sample_roots(dome(), 321, jax.random.key(5))
    points_on(dome(), uv)
    normals_on(dome(), uv)
    assert programs(area_up_to, roots_in, points_on, normals_on) == before


@pytest.mark.slow
def test_a_refinement_compiles_nothing_anew():
    """Whatever it is: of photographs, a tree and a hull of the shapes said before."""
    case = jax.tree.map(
        lambda x: x.astype(jnp.float32) if eqx.is_inexact_array(x) else x,
        refine_case(CONFIG.strands, KNOTS, 3),
    )
    shapes = Shapes(3, (HEIGHT, WIDTH), case.hull.grid.shape, 5, KNOTS)
    compile_refinement(shapes, CONFIG)
    before = programs(place, grow_placed, descend, move)
    tree, samples, seen, volume, places, _ = case
    refine(tree, samples, seen, volume, places, CONFIG, room=5)
    assert programs(place, grow_placed, descend, move) == before


def test_paths_compile_nothing_anew():
    shape = (9, 8, 7)
    compile_paths(shape, steps_on(0.004))
    before = programs(trace)
    hair = np.ones(shape, bool)
    hull = Hull(Grid(np.zeros(3), 0.004, shape), hair, -1.0 * hair, 1.0 * hair)
    along = np.ones((*shape, 3))
    roots = np.full((3, 3), 0.01)
    config = steps_on(0.004)
    space = space_of(hull, Field(along, 1.0 * hair), along)
    grow_paths(space, roots, roots, KNOTS, config)
    assert programs(trace) == before


def test_light_compiles_nothing_anew():
    """Whatever shows the hair: as many photographs of it, with as many pixels each."""
    rng = np.random.default_rng(0)
    roots = rng.normal(size=(700, 3))
    roots[:, 1] = np.abs(roots[:, 1]) + 0.3
    roots *= RADIUS / np.linalg.norm(roots, axis=1, keepdims=True)
    strands, head = comb(roots, knots=60), ball()
    compile_looks(700, 60, 2, head)
    before = programs(volume_of, arriving, both_terms)
    taken = photograph(strands, ring(2), head)
    grey = [
        dataclasses.replace(view, image=np.full_like(view.image, 0.2))
        for view in taken.views
    ]
    sights = list(map(Sight, grey, taken.depths))
    assert find_appearance(strands, sights, head) is not None
    assert programs(volume_of, arriving, both_terms) == before


def test_strands_compile_nothing_anew():
    """Whatever tree of about as many clusters they grow from."""
    tree = refine_case(60, KNOTS, 1).tree
    compile_strands(40, KNOTS, 300, 11)
    before = programs(grow)
    single = jax.tree.map(lambda x: x.astype(jnp.float32), tree)
    hair = sample_hair(single, 300, 11, jax.random.key(4))
    assert hair.strands.shape == (300, 11, 3)
    assert programs(grow) == before
