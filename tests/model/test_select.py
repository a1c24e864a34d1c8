import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from hairfit.model import select
from hairfit.model.select import Knot

# Two root clusters; 2, 3 and 4 below the first, 5 below 3.
CIRCLES = [
    (0.3, 0.3, 0.2),
    (0.8, 0.8, 0.1),
    (0.2, 0.3, 0.05),
    (0.3, 0.3, 0.05),
    (0.4, 0.3, 0.05),
    (0.3, 0.32, 0.02),
]
PARENT = [-1, -1, 0, 0, 0, 3]
# A camera 2 m above the flat scalp's middle that looks down: column along x, row
# along z.
CAMERA = np.array(
    [[100.0, -50.0, 0.0, 50.0], [0.0, -50.0, 100.0, 50.0], [0.0, -1.0, 0.0, 2.0]]
)


@pytest.fixture
def tree(flat, make_tree):
    return make_tree(flat, CIRCLES, PARENT)


def skeletons(tree):
    return np.asarray(tree.cylinder.skeleton)


def seen(p):
    at = CAMERA @ np.append(p, 1.0)
    return at[:2] / at[2]


def test_a_sphere_takes_the_control_points_inside(tree):
    rng = np.random.default_rng(0)
    for _ in range(40):
        centre, radius = rng.uniform(size=3) * [1.0, 0.2, 1.0], rng.uniform(0.0, 0.5)
        mask = select.knots_in_sphere(tree, centre, radius)
        slow = [
            [np.sqrt(sum((p - centre) ** 2)) <= radius for p in one]
            for one in skeletons(tree)
        ]
        assert np.array_equal(mask, slow)
        some = [i for i, row in enumerate(slow) if any(row)]
        every = [i for i, row in enumerate(slow) if all(row)]
        assert select.clusters_of(mask).tolist() == some
        assert select.clusters_of(mask, whole=True).tolist() == every
    assert select.knots_in_sphere(tree, skeletons(tree)[2, 3], 0.0).sum() == 1


def test_the_closest_control_point_is_picked(tree):
    for cluster, knot in ((0, 0), (4, 5), (5, 3)):
        p = skeletons(tree)[cluster, knot] + 1e-6
        assert select.nearest_knot(tree, p) == Knot(cluster, knot)
    far = np.array([9.0, 0.0, 9.0])
    found = select.nearest_knot(tree, far, among=np.array([0, 2]))
    away = np.linalg.norm(skeletons(tree) - far, axis=-1)
    assert found.cluster in (0, 2) and away[found] == away[[0, 2]].min()
    with pytest.raises(ValueError, match="there is no cluster to pick"):
        select.nearest_knot(tree, far, among=np.array([], int))


def test_what_a_camera_sees_closest_to_the_pixel_is_picked(tree):
    p = skeletons(tree)[4, 5]
    found = select.pick_knot(tree, CAMERA, seen(p) + 0.001)
    assert found is not None
    # None that is as close lies in front of it.
    assert np.linalg.norm(seen(skeletons(tree)[found]) - seen(p)) < 0.51
    assert skeletons(tree)[found][1] >= p[1]
    assert select.pick_knot(tree, CAMERA, (900.0, 900.0)) is None
    only = select.pick_knot(tree, CAMERA, seen(p), 1e-6, np.array([4]))
    assert only == Knot(4, 5)


def test_of_control_points_in_one_place_the_front_one_is_picked(flat, make_tree):
    tree = make_tree(flat, [(0.5, 0.5, 0.1)], [-1])
    heights = jnp.array([0.0, 0.2, 0.4, 0.6, 0.8, 3.0])  # the last is behind the camera
    up = jnp.stack([jnp.full(6, 0.5), heights, jnp.full(6, 0.5)], axis=1)[None]
    tree = eqx.tree_at(lambda t: t.cylinder.skeleton, tree, up)
    # It looks straight down where x = z = 0.5.
    assert select.pick_knot(tree, CAMERA, seen(up[0, 0])) == Knot(0, 4)
    mask = select.knots_in_rectangle(tree, CAMERA, (-1e9, -1e9), (1e9, 1e9))
    assert mask.tolist() == [[True] * 5 + [False]]
    assert np.isnan(select.project(CAMERA, np.asarray(up)).pixel[0, 5]).all()


def test_a_rectangle_in_a_camera_takes_what_projects_into_it(tree):
    low, high = np.array([40.0, 30.0]), np.array([60.0, 60.0])
    mask = select.knots_in_rectangle(tree, CAMERA, low, high)
    for cluster, row in enumerate(skeletons(tree)):
        for knot, p in enumerate(row):
            inside = (seen(p) >= low).all() and (seen(p) <= high).all()
            assert mask[cluster, knot] == inside
    assert mask.any() and not mask.all()


def test_a_rectangle_on_the_scalp_takes_centres_or_whole_contours(tree):
    low, high = (0.15, 0.25), (0.35, 0.35)
    assert select.clusters_in_rectangle(tree, low, high).tolist() == [0, 2, 3, 5]
    # The contour of 0 is larger than the rectangle, that of 2 reaches over its side.
    whole = select.clusters_in_rectangle(tree, (0.16, 0.24), (0.36, 0.36), whole=True)
    assert whole.tolist() == [3, 5]


def test_a_polygon_on_the_scalp_may_have_a_notch(tree):
    # A box over all of the first family, with a notch that reaches to its middle.
    notch = [(0.0, 0.0), (0.6, 0.0), (0.6, 0.6), (0.31, 0.6), (0.3, 0.25), (0.29, 0.6)]
    around = [*notch, (0.0, 0.6)]
    assert select.clusters_in_polygon(tree, around).tolist() == [2, 4]
    box = [(0.0, 0.0), (0.0, 0.6), (0.6, 0.6), (0.6, 0.0)]
    assert select.clusters_in_polygon(tree, box).tolist() == [0, 2, 3, 4, 5]
    small = [(0.24, 0.24), (0.24, 0.36), (0.46, 0.36), (0.46, 0.24)]
    assert select.clusters_in_polygon(tree, small, whole=True).tolist() == [3, 4, 5]
    with pytest.raises(ValueError, match="at least 3 corners, got 2"):
        select.clusters_in_polygon(tree, box[:2])


def test_a_rectangle_as_a_polygon_takes_the_same(tree):
    low, high = np.array([0.21, 0.1]), np.array([0.95, 0.95])
    box = [low, (high[0], low[1]), high, (low[0], high[1])]
    for whole in (False, True):
        by_box = select.clusters_in_rectangle(tree, low, high, whole=whole)
        by_lasso = select.clusters_in_polygon(tree, box, whole=whole)
        assert by_box.tolist() == by_lasso.tolist()


def test_depth_counts_from_the_root_clusters(tree):
    found = [select.clusters_above(tree, depth).tolist() for depth in range(4)]
    assert found == [[], [0, 1], [0, 1, 2, 3, 4], [0, 1, 2, 3, 4, 5]]


def test_a_walk_goes_down_up_and_around(tree):
    assert select.first_child(tree, 0) == 2
    assert select.first_child(tree, 3) == 5
    assert select.first_child(tree, 5) == 5
    assert [select.next_sibling(tree, i) for i in range(6)] == [1, 0, 3, 4, 2, 5]
    assert [select.previous_sibling(tree, i) for i in range(6)] == [1, 0, 4, 2, 3, 5]
    assert [select.parent_of(tree, i) for i in range(6)] == [0, 1, 0, 0, 0, 3]


@pytest.mark.parametrize(
    "step",
    [
        select.parent_of,
        select.first_child,
        select.next_sibling,
        select.previous_sibling,
    ],
)
def test_a_walk_from_nowhere_is_refused(tree, step):
    for index in (-1, 6):
        with pytest.raises(ValueError, match=f"no cluster {index}; a tree of 6"):
            step(tree, index)
