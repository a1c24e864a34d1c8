"""Whether a head stands where a photograph shows the person, and which pose mends it.

The head's mesh has an outline in every photograph; beside the hair, the person begins
and ends there. A camera whose pose is wrong shows the person elsewhere.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float
from scipy import fft, ndimage
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from ..capture.capture import View
from ..capture.cranium import find_cranium
from ..render.camera import Camera
from ..render.raster import mesh_depth
from ..types import Mesh

GAP = 3  # pixels between masks of hair and of the rest that belong to the person
HAIR_REACH = 5  # pixels from hair within which an outline may be the hair's
FARTHEST = 30.0  # pixels: outlines farther off count as this far off
LEAST_EDGE = 50  # pixels of outline, without which nothing is told
ROUNDS = 6  # outlines are found anew after each turn
STEADY = 2e-4  # radians: the last turn
SHARPEST = 0.5  # pixels within which outlines agree
LOOSE = 3.0  # pixels off, in the mean, that a turn of one radian must be worth


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

    Pixels in which hair and skin are mixed may be in neither mask: such gaps are the
    person's.

    Args:
        head: Where the head would be seen.
        body: Where the photograph shows the person.
        hair: Where it shows hair, which hides the head.
    """
    area = max(int(head.sum()), 1)
    outside = (body & ~head & ~hair).sum()
    bare = (head & ~whole_person(body, hair)).sum()
    return Misfit(float(outside / area), float(bare / area))


def whole_person(
    body: Bool[np.ndarray, "height width"], hair: Bool[np.ndarray, "height width"]
) -> Bool[np.ndarray, "height width"]:
    """Return where hair or the rest of a person is, and in narrow gaps between them."""
    person = np.pad(body | hair, 2 * GAP, mode="edge")
    wide = ndimage.maximum_filter(person, size=2 * GAP + 1)
    closed = np.asarray(ndimage.minimum_filter(wide, size=2 * GAP + 1), bool)
    return closed[2 * GAP : -2 * GAP, 2 * GAP : -2 * GAP]


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


def register(
    view: View, depth: Float[np.ndarray, "height width"], head: Mesh
) -> Registered:
    """Return the turn of the camera after which the head fits the person best.

    Two kinds of turns are tried, each by outlines that approach each other along their
    normals [Chen and Medioni, *Object modelling by registration of multiple range
    images*, 1992]: where the camera stands, from the shift that correlates best, and
    about the head. All six freedoms together are worse: outlines hardly tell these
    apart. Hair hides the head and counts for neither.

    Args:
        view: The photograph, shrunken, with `body`.
        depth: Depth of the head in it, in metres.
        head: The head.
    """
    body, hair = view.body, view.hair
    if body is None:
        raise ValueError("`register` needs the mask of the person.")
    here = np.asarray(view.camera.centre, np.float64)
    seen = np.isfinite(depth)
    shift = _best_shift(seen, body, hair) / view.camera.focal
    found = []
    for centre, start in ((here, shift), (find_cranium(head).centre, np.zeros(3))):
        turn = _best_turn(view, head, centre, start)
        camera = turned_camera(view.camera, centre, turn)
        after = misfit(np.isfinite(mesh_depth(head, camera)), body, hair)
        found.append((after.total, camera, after, turn, centre is not here))
    _, camera, after, turn, about_head = min(found, key=lambda one: one[0])
    turn_deg = float(np.degrees(np.linalg.norm(turn)))
    return Registered(camera, misfit(seen, body, hair), after, turn_deg, about_head)


def _best_turn(
    view: View,
    head: Mesh,
    centre: Float[np.ndarray, " 3"],
    start: Float[np.ndarray, " 3"],
) -> Float[np.ndarray, " 3"]:
    """Return the turn about a point that brings outlines together, in radians."""
    inside = _depth_inside(whole_person(np.asarray(view.body), view.hair))
    size = 2 * HAIR_REACH + 1
    hidden = np.asarray(ndimage.maximum_filter(view.hair, size=size), bool)
    turn = start
    for _ in range(ROUNDS):
        camera = turned_camera(view.camera, centre, turn)
        apart, slope = _compare_outlines(
            mesh_depth(head, camera), camera, centre, inside, hidden
        )
        if len(apart) < LEAST_EDGE:
            break
        loose = np.sqrt(len(apart)) * LOOSE * np.eye(3)
        rows = np.concatenate([slope, loose])
        wanted = np.concatenate([apart, -loose @ turn])
        step = least_squares(
            lambda at, rows=rows, wanted=wanted: rows @ at - wanted,
            np.zeros(3),
            jac=lambda _, rows=rows: rows,  # pyright: ignore[reportArgumentType]
            loss="cauchy",
            f_scale=max(float(np.median(np.abs(apart))), SHARPEST),
        ).x
        turn = (Rotation.from_rotvec(step) * Rotation.from_rotvec(turn)).as_rotvec()
        if np.linalg.norm(step) < STEADY:
            break
    return turn


def _compare_outlines(
    depth: Float[np.ndarray, "height width"],
    camera: Camera,
    centre: Float[np.ndarray, " 3"],
    inside: Float[np.ndarray, "height width"],
    hidden: Bool[np.ndarray, "height width"],
) -> tuple[Float[np.ndarray, " edge"], Float[np.ndarray, "edge 3"]]:
    """Return how far the head's outline is from the person's, and what turns change.

    Args:
        depth: Depth of the head, in metres.
        camera: The camera that sees it so.
        centre: What the camera is turned about, in metres.
        inside: How deep each pixel lies in the person, negative beside it, in pixels.
        hidden: Where hair hides both outlines.

    Returns:
        For each pixel of the head's outline, how many pixels it must move inwards to
        be the person's, and by how many it does for each radian of a turn.
    """
    seen = np.isfinite(depth)
    # Where the picture ends, no outline ends.
    within = np.asarray(ndimage.binary_erosion(seen, border_value=1), bool)
    edge = seen & ~within & ~hidden
    row, column = np.nonzero(edge)
    own = _depth_inside(seen)
    down, right = np.gradient(own)
    inwards = np.stack([right[row, column], down[row, column]], axis=1)
    inwards /= np.maximum(np.linalg.norm(inwards, axis=1, keepdims=True), 1e-6)
    K, pose = (np.asarray(m, np.float64) for m in (camera.K, camera.cam_from_world))
    z = depth[row, column]
    x = (column + 0.5 - K[0, 2]) / K[0, 0] * z
    y = (row + 0.5 - K[1, 2]) / K[1, 1] * z
    # How a normal's pixels change with the point, and the point with the turn.
    across = inwards[:, 0] * K[0, 0] / z, inwards[:, 1] * K[1, 1] / z
    along = -(across[0] * x + across[1] * y) / z
    arm = np.stack([x, y, z], axis=1) - (pose[:3, :3] @ centre + pose[:3, 3])
    slope = np.cross(arm, np.stack([*across, along], axis=1))
    return own[row, column] - inside[row, column], slope


def _depth_inside(
    mask: Bool[np.ndarray, "height width"],
) -> Float[np.ndarray, "height width"]:
    """Return how deep pixels lie in a mask, negative beside it, in pixels."""
    if mask.all() or not mask.any():
        return np.full(mask.shape, FARTHEST if mask.any() else -FARTHEST)
    deep = ndimage.distance_transform_edt(mask)
    deep = np.asarray(deep) - np.asarray(ndimage.distance_transform_edt(~mask))
    return ndimage.gaussian_filter(np.clip(deep, -FARTHEST, FARTHEST), 1.0)


def _best_shift(
    head: Bool[np.ndarray, "height width"],
    body: Bool[np.ndarray, "height width"],
    hair: Bool[np.ndarray, "height width"],
) -> Float[np.ndarray, " 3"]:
    """Return the turn in pixels, about x and y, that lays the head over the person."""
    # Outside of the picture anything may be: zeros.
    wanted = body.astype(float) - (~body & ~hair)
    # The convolution with the mirrored head; `scipy.signal` takes 0.4 s to import.
    full = [2 * edge - 1 for edge in wanted.shape]
    size = [fft.next_fast_len(edge, real=True) for edge in full]
    parts = (wanted, head[::-1, ::-1].astype(float))
    one, other = (np.asarray(fft.rfft2(part, size)) for part in parts)
    score = np.asarray(fft.irfft2(one * other, size))[: full[0], : full[1]]
    row, column = np.unravel_index(np.argmax(score), score.shape)
    down, right = float(row) - (head.shape[0] - 1), float(column) - (head.shape[1] - 1)
    return np.array([-down, right, 0.0])
