"""A head from a formula: its distance, its mesh and its scalp. Metres."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..capture.cranium import square_to_disc
from ..model import Scalp
from ..types import Mesh

CRANIUM = np.array([0.0, 0.03, -0.01])
FACES = 5000
CELL = 0.005
LOW, HIGH = np.array([-0.1, -0.23, -0.13]), np.array([0.1, 0.14, 0.14])
NECK_END = -0.185
BLOCK = 8192  # points at a time, so that what lies between stays in the cache
PROUD = 0.0004  # the patch dips between its control points: keep it off the mesh
CROWN_TILT = np.radians(22.0)

# Polar angles of the hairline about the crown, from the middle of the forehead to the
# nape, at even azimuths: forehead, temple, above the ear, behind it, nape.
HAIRLINE = np.radians([76.0, 82.0, 94.0, 112.0, 118.0])


def head_distance(p: Float[np.ndarray, "*points 3"]) -> Float[np.ndarray, "*points"]:
    """Return about how far points are outside of the head; negative inside.

    Ellipsoids and a neck are blended. The zero set is exact, the distance to first
    order, which is what keeping hair off the head takes.
    """
    p = np.asarray(p, np.float64)
    flat = p.reshape(-1, 3)
    out = np.empty(len(flat))
    for start in range(0, len(flat), BLOCK):
        block = slice(start, start + BLOCK)
        out[block] = _distance(flat[block])
    return out.reshape(p.shape[:-1])


def _distance(p: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    """Return `head_distance` of points that are few enough to be fast."""
    mirrored = np.concatenate([np.abs(p[..., :1]), p[..., 1:]], -1)
    out = ellipsoid(p, [0.0, 0.036, -0.010], [0.073, 0.086, 0.096])
    out = blend(out, ellipsoid(p, [0.0, -0.025, 0.035], [0.059, 0.080, 0.055]), 0.03)
    out = blend(out, ellipsoid(p, [0.0, -0.078, 0.058], [0.034, 0.026, 0.030]), 0.03)
    out = blend(out, neck(p), 0.025)
    socket = ellipsoid(mirrored, [0.030, 0.006, 0.103], [0.017, 0.010, 0.018])
    out = -blend(-out, socket, 0.012)
    ball = ellipsoid(mirrored, [0.030, 0.005, 0.072], [0.012, 0.009, 0.012])
    out = blend(out, ball, 0.003)
    for centre, radii, width in (
        ([0.0, -0.012, 0.088], [0.007, 0.026, 0.012], 0.014),  # bridge of the nose
        ([0.0, -0.032, 0.097], [0.011, 0.008, 0.011], 0.010),  # tip of the nose
        ([0.0, -0.056, 0.086], [0.020, 0.004, 0.008], 0.005),  # upper lip
        ([0.0, -0.064, 0.084], [0.017, 0.004, 0.008], 0.005),  # lower lip
    ):
        out = blend(out, ellipsoid(p, centre, radii), width)
    ear = ellipsoid(mirrored, [0.074, -0.003, -0.010], [0.008, 0.029, 0.017])
    return blend(out, ear, 0.006)


def ellipsoid(p, centre, radii) -> Float[np.ndarray, "*points"]:
    """Return the distance from an ellipsoid, to first order at its surface."""
    scaled = (p - np.asarray(centre)) / np.asarray(radii)
    square = scaled * scaled
    gradient = np.sqrt(square @ (1.0 / np.square(radii)))
    inside = np.sqrt(square.sum(-1))
    return inside * (inside - 1.0) / np.maximum(gradient, 1e-9)


def neck(p) -> Float[np.ndarray, "*points"]:
    """Return the distance from the neck: a leaning cylinder that widens downwards."""
    y = np.minimum(p[..., 1], -0.03)
    radius = 0.049 + 4.0 * np.clip(-0.15 - y, 0.0, None) ** 2
    middle = -0.022 + 0.10 * (y + 0.03)
    across = np.hypot(p[..., 0], p[..., 2] - middle) - radius
    top = np.maximum(across, p[..., 1])
    return -blend(-top, p[..., 1] - NECK_END, 0.02)


def blend(a, b, width: float) -> Float[np.ndarray, "*points"]:
    """Return the union of two bodies, smooth within `width`."""
    share = np.clip(0.5 + 0.5 * (b - a) / width, 0.0, 1.0)
    return b + (a - b) * share - width * share * (1.0 - share)


def head_normal(p: Float[np.ndarray, "*points 3"]) -> Float[np.ndarray, "*points 3"]:
    """Return the unit direction in which the distance from the head grows."""
    step = 1e-4 * np.eye(3)
    gradient = np.stack(
        [head_distance(p + one) - head_distance(p - one) for one in step], -1
    )
    size = np.linalg.norm(gradient, axis=-1, keepdims=True)
    return gradient / np.maximum(size, 1e-12)


def make_head() -> Mesh:
    """Return the head as a watertight mesh of about 5 000 faces.

    The face looks along +z, the crown along +y; the origin lies between the ears.
    """
    import igl

    count = np.ceil((HIGH - LOW) / CELL).astype(int) + 1
    axes = [
        low + CELL * np.arange(number) for low, number in zip(LOW, count, strict=True)
    ]
    z, y, x = np.meshgrid(axes[2], axes[1], axes[0], indexing="ij")
    grid = np.stack([x, y, z], -1).reshape(-1, 3)
    dense = igl.marching_cubes(head_distance(grid), grid, *count.tolist())
    few = igl.qslim(np.asarray(dense[0]), np.asarray(dense[1], np.int64), FACES)
    vertices, faces = np.asarray(few[0]), np.asarray(few[1], np.int64)
    # Fewer faces move vertices off the surface: put them back.
    for _ in range(3):
        vertices -= head_distance(vertices)[:, None] * head_normal(vertices)
    mesh = Mesh(np.round(vertices, 6), faces)
    corner = mesh.vertices[mesh.faces]
    volume = np.einsum("ij,ij->i", corner[:, 0], np.cross(corner[:, 1], corner[:, 2]))
    return mesh if volume.sum() > 0.0 else Mesh(mesh.vertices, mesh.faces[:, ::-1])


def make_scalp(mesh: Mesh) -> Scalp:
    """Return the scalp of the head that `make_head` makes.

    The square of (u, v) goes to a disc about the crown, the disc to directions from
    the middle of the cranium, and rays in these directions to the mesh. u runs from
    the person's right to the left, v from the forehead to the nape, so that du x dv
    points outwards.
    """
    import trimesh

    direction = scalp_directions(np.linspace(-1.0, 1.0, 13))
    surface = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    ray = direction.reshape(-1, 3)
    origin = np.broadcast_to(CRANIUM, ray.shape)
    hit, index, _ = surface.ray.intersects_location(origin, ray, multiple_hits=True)
    control = np.zeros((13 * 13, 3))
    distance = np.einsum("ij,ij->i", hit - CRANIUM, ray[index])
    # The ear lies before the side of the head: of several hits the first is the scalp.
    for k in np.argsort(-distance, kind="stable"):
        control[index[k]] = hit[k] + PROUD * ray[index[k]]
    control = np.round(control, 6).reshape(13, 13, 3)
    return Scalp(jnp.asarray(control, jnp.float32))


def scalp_directions(side: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n n 3"]:
    """Return the directions of a square grid over [-1, 1]^2, about the crown."""
    a, b = np.meshgrid(side, side, indexing="ij")
    x, y = square_to_disc(a, b)
    radius, azimuth = np.hypot(x, y), np.arctan2(np.abs(x), -y)
    limit = np.interp(azimuth, np.linspace(0.0, np.pi, len(HAIRLINE)), HAIRLINE)
    polar = radius * limit
    level = np.sin(polar) / np.maximum(radius, 1e-12)
    local = np.stack([level * x, np.cos(polar), -level * y], -1)
    cos, sin = np.cos(CROWN_TILT), np.sin(CROWN_TILT)
    back = np.array([[1.0, 0.0, 0.0], [0.0, cos, sin], [0.0, -sin, cos]])
    return local @ back.T
