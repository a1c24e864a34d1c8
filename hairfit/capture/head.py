"""The head mesh of a capture, and what it must be before hair is put on it."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from ..errors import InputError
from ..io.mesh import load_mesh
from ..model.scalp import Scalp
from ..render.raster import project_points
from ..types import Mesh
from .cameras import CameraEntry, common_point
from .cranium import even_directions, find_cranium

# Share of the rays out of the cranium that may escape: an artist's seam, no hole.
MOST_ESCAPING = 0.01
# In metres, a head (with or without shoulders) fills the picture about once; a factor
# of 10 either way is far from that, and still nearer than centimetres are.
UNITS = {"millimetres": 0.001, "centimetres": 0.01, "metres": 1.0}


def load_head(path: Path, entries: Sequence[CameraEntry]) -> Mesh:
    """Return the head, in metres and its faces turned outwards.

    Args:
        path: The mesh file.
        entries: The cameras that photographed the head.

    Raises:
        InputError: If the mesh cannot be read, is not in metres or has a hole in its
            cranium, or if a camera does not look at it.
    """
    mesh = load_mesh(path)
    check_units(mesh, entries, path)
    check_cranium(mesh, path)
    check_in_sight(mesh, entries, path)
    return turned_outwards(mesh)


def check_units(mesh: Mesh, entries: Sequence[CameraEntry], path: Path) -> None:
    """Refuse a head that is not in metres, as the cameras show."""
    extent = float(np.ptp(mesh.vertices, axis=0).max())
    target = common_point(entries)
    if target is not None:
        share = []
        for entry in entries:
            camera = entry.camera
            distance = np.linalg.norm(target - np.asarray(camera.centre))
            focal = camera.focal / max(camera.width, camera.height)
            share.append(extent * focal / max(float(distance), 1e-9))
        fills = float(np.median(share))
        misfit = {unit: abs(np.log(fills * factor)) for unit, factor in UNITS.items()}
        unit = min(misfit, key=misfit.__getitem__)
        if unit != "metres":
            raise InputError(
                f"the head '{path}' is in {unit} but the cameras are not; scale it by "
                f"{UNITS[unit]:g} to metres."
            )
    if not 0.05 < extent < 5.0:
        factor = 10.0 ** round(np.log10(0.3 / extent))
        raise InputError(
            f"the head '{path}' is {extent:g} wide, which is not in metres; scale it "
            f"by {factor:g}, and the cameras with it if they are in the same unit."
        )


def check_cranium(mesh: Mesh, path: Path) -> None:
    """Refuse a head with a hole above the ears; an open neck does no harm."""
    import trimesh

    rays = even_directions(2000, 0.0)
    body = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    start = np.broadcast_to(find_cranium(mesh).centre, rays.shape)
    escaping = 1.0 - float(np.mean(body.ray.intersects_any(start, rays)))
    if escaping > MOST_ESCAPING:
        raise InputError(
            f"the head '{path}' has a hole in its cranium ({100 * escaping:.0f} % of "
            "it is open); close it (an open neck may stay), and see that y points up."
        )


def check_in_sight(mesh: Mesh, entries: Sequence[CameraEntry], path: Path) -> None:
    """Refuse cameras that do not have the head in their pictures."""
    cameras = path.parent / "cameras.json"
    blind = [e.name for e in entries if not in_picture(mesh.vertices, e).any()]
    advice = (
        "'cam_from_world' must map the world to the camera, x right, y down, z forward"
    )
    if blind and len(blind) == len(entries):
        raise InputError(
            f"all cameras in '{cameras}' look away from the head '{path}'; {advice}."
        )
    if blind:
        raise InputError(
            f"camera '{blind[0]}' in '{cameras}' looks away from the head '{path}'; "
            f"mend it or leave it out with --views ({advice})."
        )


def in_picture(
    points: Float[np.ndarray, "points 3"], entry: CameraEntry
) -> Bool[np.ndarray, " points"]:
    """Return which points lie before the camera and within its picture."""
    pixel, depth = project_points(points, entry.camera)
    size = [entry.camera.width, entry.camera.height]
    return (depth > 1e-9) & ((pixel >= 0) & (pixel <= size)).all(axis=1)


def turned_outwards(mesh: Mesh) -> Mesh:
    """Return the mesh, its faces reversed if they look inwards."""
    import igl

    inside = igl.winding_number(
        np.asarray(mesh.vertices, np.float64),
        np.asarray(mesh.faces, np.int64),
        np.asarray(find_cranium(mesh).centre, np.float64)[None],
    )
    if float(np.ravel(inside)[0]) > 0:
        return mesh
    return Mesh(mesh.vertices, np.ascontiguousarray(mesh.faces[:, ::-1]))


def check_scalp(scalp: Scalp, head: Mesh, path: Path) -> None:
    """Refuse a scalp that lies off the head."""
    control = np.asarray(scalp.control).reshape(-1, 3)
    low, high = head.vertices.min(axis=0) - 0.05, head.vertices.max(axis=0) + 0.05
    if not ((control >= low) & (control <= high)).all():
        raise InputError(
            f"the scalp '{path}' lies off the head; give its points in metres, in the "
            "frame of 'head.obj', or remove it."
        )
