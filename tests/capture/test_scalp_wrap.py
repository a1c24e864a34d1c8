import jax
import jax.numpy as jnp
import numpy as np
import pytest
import trimesh

from hairfit.capture import View
from hairfit.capture.cranium import find_cranium
from hairfit.capture.scalp_wrap import HIGHEST, LOWEST, SeenHead, wrap_scalp
from hairfit.model import scalp_normal, scalp_point, scalp_tangents
from hairfit.render import Camera, mesh_depth, project_points
from hairfit.synthetic.scene import looking_at
from hairfit.types import Mesh

RADIUS, SIZE = 0.09, 96


def ball(centre=(0.0, 0.0, 0.0), half=(RADIUS, RADIUS, RADIUS)):
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=1.0)
    vertices = np.asarray(mesh.vertices) * half + np.asarray(centre)
    return Mesh(vertices, np.asarray(mesh.faces, np.int64))


def every(scalp, side=25):
    """Return points and normals all over a patch, its border included."""
    share = np.linspace(0.0, 1.0, side)
    uv = jnp.asarray(np.stack(np.meshgrid(share, share, indexing="ij"), -1))
    uv = uv.reshape(-1, 2)
    points = jax.vmap(scalp_point, (None, 0))(scalp, uv)
    normals = jax.vmap(scalp_normal, (None, 0))(scalp, uv)
    return np.asarray(points), np.asarray(normals)


@pytest.fixture(scope="module")
def bare():
    return wrap_scalp(ball())


def photographs(head, centre, hairline):
    """Return six views in which the skin above the height `hairline` is hair."""
    seen = []
    for k in range(6):
        angle = np.pi * k / 3
        eye = np.array([0.6 * np.sin(angle), 0.15, 0.6 * np.cos(angle)])
        pose = looking_at(eye + centre, np.asarray(centre, float))
        K = jnp.array([[200.0, 0, SIZE / 2], [0, 200.0, SIZE / 2], [0, 0, 1]])
        camera = Camera(K, jnp.asarray(pose), SIZE, SIZE)
        depth = mesh_depth(head, camera)
        met = np.isfinite(depth)
        row, column = np.nonzero(met)
        pixel = np.stack([column + 0.5, row + 0.5, np.ones(len(row))], axis=1)
        p_cam = pixel @ np.linalg.inv(K).T * depth[met][:, None]
        p_world = (p_cam - pose[:3, 3]) @ pose[:3, :3]
        assert np.allclose(project_points(p_world, camera).depth, depth[met])
        hair = np.zeros((SIZE, SIZE), bool)
        hair[met] = p_world[:, 1] - centre[1] > hairline
        view = View(f"{k}", camera, np.zeros((SIZE, SIZE, 3)), hair)
        seen.append(SeenHead(view, depth))
    return seen


def test_the_patch_lies_on_the_head(bare):
    points, _ = every(bare)
    away = np.linalg.norm(points, axis=1) - RADIUS
    assert np.abs(away).max() < 0.001
    assert away.min() > -0.0006


def test_its_normals_point_outwards(bare):
    points, normals = every(bare)
    assert ((points / RADIUS * normals).sum(axis=1) > 0.9).all()


def test_it_does_not_fold(bare):
    share = jnp.linspace(0.02, 0.98, 15)
    uv = jnp.stack(jnp.meshgrid(share, share), axis=-1).reshape(-1, 2)
    du, dv = jax.vmap(scalp_tangents, (None, 0))(bare, uv)
    outward = jax.vmap(scalp_point, (None, 0))(bare, uv) / RADIUS
    side = jnp.sum(jnp.cross(du, dv) * outward, axis=1)
    assert (side > 0).all() or (side < 0).all()


def test_without_photographs_hair_grows_as_on_most_people(bare):
    cranium = find_cranium(ball())
    points, _ = every(bare)
    away = points - cranium.centre
    polar = np.arccos(away @ cranium.axes[2] / np.linalg.norm(away, axis=1))
    azimuth = np.arctan2(away @ cranium.axes[0], away @ cranium.axes[1])
    lowest = np.interp(np.abs(azimuth), np.linspace(0, np.pi, len(LOWEST)), LOWEST)
    assert (polar < lowest + np.radians(10)).all()
    front, back = np.abs(azimuth) < 0.2, np.abs(azimuth) > np.pi - 0.2
    assert np.isclose(polar[front].max(), LOWEST[0], atol=np.radians(4))
    assert np.isclose(polar[back].max(), LOWEST[-1], atol=np.radians(4))


@pytest.mark.parametrize("seen", [False, True])
def test_nothing_depends_on_the_origin(seen):
    shift = np.array([3.0, -2.0, 5.0])
    patches = []
    for centre in (np.zeros(3), shift):
        head = ball(centre)
        votes = photographs(head, centre, 0.01) if seen else ()
        patches.append(np.asarray(wrap_scalp(head, votes).control) - centre)
    assert np.allclose(patches[0], patches[1], atol=1e-4)


def test_skin_that_is_seen_draws_the_border_in(bare):
    centre = np.zeros(3)
    heights = []
    for hairline in (-1.0, 0.0, 0.03):
        scalp = wrap_scalp(ball(), photographs(ball(), centre, hairline))
        points, normals = every(scalp)
        assert np.abs(np.linalg.norm(points, axis=1) - RADIUS).max() < 0.001
        heights.append(points[:, 1].min())
    assert np.isclose(heights[0], every(bare)[0][:, 1].min(), atol=0.003)
    assert (np.diff(heights) > 0.02).all()
    assert np.isclose(heights[2], 0.03, atol=0.012)


def test_a_head_that_is_seen_bald_keeps_a_cap():
    scalp = wrap_scalp(ball(), photographs(ball(), np.zeros(3), 1.0))
    points, _ = every(scalp)
    cranium = find_cranium(ball())
    away = points - cranium.centre
    polar = np.arccos(away @ cranium.axes[2] / np.linalg.norm(away, axis=1))
    assert np.isclose(polar.max(), HIGHEST, atol=np.radians(4))


def test_ears_and_holes_are_not_the_scalp():
    head = trimesh.creation.icosphere(subdivisions=5, radius=RADIUS)
    vertices = np.asarray(head.vertices)
    ear = np.linalg.norm(vertices - [RADIUS, 0.0, 0.0], axis=1) < 0.008
    vertices = np.where(ear[:, None], vertices * 1.25, vertices)
    points, _ = every(wrap_scalp(Mesh(vertices, np.asarray(head.faces, np.int64))))
    away = np.linalg.norm(points, axis=1) - RADIUS
    near = np.linalg.norm(points - [RADIUS, 0.0, 0.0], axis=1) < 0.02
    assert near.any()
    assert np.abs(away[~near]).max() < 0.0015
    # Over the ear the patch rises to lie on it, but does not follow its edges.
    assert away[near].max() < 0.25 * RADIUS + 0.001
