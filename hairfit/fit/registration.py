"""Whether a head stands where a photograph shows the person, and which pose mends it.

The head's mesh has an outline in every photograph; beside the hair, the person begins
and ends there. A camera whose pose is wrong shows the person elsewhere.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage, signal
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from ..capture.capture import View
from ..capture.cranium import find_cranium
from ..render.camera import Camera
from ..render.raster import cells, mesh_depth, project_points
from ..types import Mesh

SAMPLES = 25_000  # points on the head's surface
CLOSING = 2  # pixels: gaps between the points
BLURS = (4.0, 1.5)  # pixels, from coarse to fine
STRIDE = 2  # one residual for so many pixels
LARGE_TURN = 1.0  # radians: costs as much as a misfit of the whole head


class Misfit(NamedTuple):
    """How far a person is from the outline of the head, in shares of the head's area.

    Attributes:
        outside: Person where there is no head.
        bare: Head where there is neither person nor hair.
    """

    outside: float
    bare: float

    @property
    def total(self) -> float:
        """Both together."""
        return self.outside + self.bare


def misfit(
    head: Bool[np.ndarray, "height width"],
    body: Bool[np.ndarray, "height width"],
    hair: Bool[np.ndarray, "height width"],
) -> Misfit:
    """Return how far a person is from the outline of the head.

    Args:
        head: Where the head would be seen.
        body: Where the photograph shows the person.
        hair: Where it shows hair, which hides the head.
    """
    area = max(int(head.sum()), 1)
    outside = (body & ~head & ~hair).sum()
    return Misfit(float(outside / area), float((head & ~body & ~hair).sum() / area))


def surface_points(head: Mesh) -> Float[np.ndarray, "points 3"]:
    """Return points spread over the head's surface, always the same ones."""
    import trimesh

    mesh = trimesh.Trimesh(head.vertices, head.faces, process=False)
    sampled = trimesh.sample.sample_surface(mesh, SAMPLES, seed=0)
    return np.concatenate([np.asarray(sampled[0]), np.asarray(head.vertices)])


def outline(
    points: Float[np.ndarray, "points 3"], camera: Camera
) -> Bool[np.ndarray, "height width"]:
    """Return where a camera sees a surface of which points are given."""
    pad = 2 * CLOSING
    drawn = np.zeros((camera.height + 2 * pad, camera.width + 2 * pad), np.uint8)
    pixels = project_points(points, camera)
    row, column, seen = cells(pixels, camera.width, camera.height)
    drawn[row[seen] + pad, column[seen] + pad] = 1
    size = 2 * CLOSING + 1
    wide = np.asarray(ndimage.maximum_filter(drawn, size=size))
    closed = np.asarray(ndimage.minimum_filter(wide, size=size))
    return closed[pad:-pad, pad:-pad] > 0


def turned_camera(
    camera: Camera,
    centre: Float[np.ndarray, " 3"],
    turn: Float[np.ndarray, " 3"],
) -> Camera:
    """Return a camera that sees the world turned about a point.

    Args:
        camera: The camera.
        centre: The point, in metres; the camera's own place turns it where it stands.
        turn: A rotation vector along the camera's axes, in radians.
    """
    old = np.asarray(camera.cam_from_world, np.float64)
    rotation = Rotation.from_rotvec(turn).as_matrix()
    middle = old[:3, :3] @ centre + old[:3, 3]
    new = np.eye(4)
    new[:3, :3] = rotation @ old[:3, :3]
    new[:3, 3] = rotation @ (old[:3, 3] - middle) + middle
    kind = camera.cam_from_world.dtype
    return Camera(camera.K, jnp.asarray(new, kind), camera.width, camera.height)


class Registered(NamedTuple):
    """A camera turned so that the head lies where its photograph shows the person.

    Attributes:
        camera: The camera.
        before: The misfit of the old camera.
        after: The misfit of the new one.
        turn_deg: By how many degrees it was turned.
        about_head: Whether it was turned about the head, not where it stands.
    """

    camera: Camera
    before: Misfit
    after: Misfit
    turn_deg: float
    about_head: bool


def register(view: View, head: Mesh) -> Registered:
    """Return the turn of the camera after which the head fits the person best.

    Two kinds of turns are tried, each by least squares on blurred outlines: where the
    camera stands, from the shift that correlates best, and about the head. All six
    freedoms together are worse: outlines hardly tell these apart. Hair hides the head
    and counts for neither.

    Args:
        view: The photograph, shrunken, with `body`.
        head: The head.
    """
    body, hair = view.body, view.hair
    if body is None:
        raise ValueError("`register` needs the mask of the person.")
    points = surface_points(head)
    first = outline(points, view.camera)
    here = np.asarray(view.camera.centre, np.float64)
    focal = float(view.camera.K[0, 0])
    found = []
    for centre, start, unit in (
        (here, _best_shift(first, body, hair) / focal, 4.0 / focal),
        (find_cranium(head).centre, np.zeros(3), 0.05),
    ):
        # A roll moves pixels as an orbit does, however far the head is.
        units = np.array([unit, unit, 0.05])
        turn = _best_turn(view, points, centre, start, units)
        camera = turned_camera(view.camera, centre, turn)
        # Exactly: points leave concave outlines a little too full.
        after = misfit(np.isfinite(mesh_depth(head, camera)), body, hair)
        found.append((after.total, camera, after, turn, centre is not here))
    _, camera, after, turn, about_head = min(found, key=lambda one: one[0])
    turn_deg = float(np.degrees(np.linalg.norm(turn)))
    before = misfit(np.isfinite(mesh_depth(head, view.camera)), body, hair)
    return Registered(camera, before, after, turn_deg, about_head)


def _best_turn(
    view: View,
    points: Float[np.ndarray, "points 3"],
    centre: Float[np.ndarray, " 3"],
    start: Float[np.ndarray, " 3"],
    units: Float[np.ndarray, " 3"],
) -> Float[np.ndarray, " 3"]:
    """Return the turn about a point that fits blurred outlines best, in radians."""
    body = np.asarray(view.body)
    free = ~np.asarray(ndimage.binary_dilation(view.hair, iterations=2), bool)
    size = np.sqrt(max(body.sum(), 1)) / STRIDE
    scaled = start / units
    for blur in BLURS:
        target = ndimage.gaussian_filter((free & body).astype(np.float32), blur)

        def residuals(at, blur=blur, target=target):
            seen = outline(points, turned_camera(view.camera, centre, at * units))
            shown = ndimage.gaussian_filter((seen & free).astype(np.float32), blur)
            apart = (shown - target)[::STRIDE, ::STRIDE]
            return np.concatenate([apart.ravel() / size, at * units / LARGE_TURN])

        # Outlines change by whole pixels: differences must span several of them.
        step = 0.1 * blur

        def slope(at, residuals=residuals, step=step):
            columns = [
                (residuals(at + step * axis) - residuals(at - step * axis)) / (2 * step)
                for axis in np.eye(3)
            ]
            return np.stack(columns, axis=1)

        scaled = least_squares(
            residuals,
            scaled,
            jac=slope,  # pyright: ignore[reportArgumentType]
            max_nfev=8,
            xtol=3e-3,
            ftol=1e-4,
        ).x
    return scaled * units


def _best_shift(
    head: Bool[np.ndarray, "height width"],
    body: Bool[np.ndarray, "height width"],
    hair: Bool[np.ndarray, "height width"],
) -> Float[np.ndarray, " 3"]:
    """Return the turn in pixels, about x and y, that lays the head over the person."""
    # Outside of the picture anything may be: zeros.
    wanted = body.astype(float) - (~body & ~hair)
    score = signal.fftconvolve(wanted, head[::-1, ::-1].astype(float))
    row, column = np.unravel_index(np.argmax(score), score.shape)
    down, right = float(row) - (head.shape[0] - 1), float(column) - (head.shape[1] - 1)
    return np.array([-down, right, 0.0])
