"""Triangle meshes in files: OBJ and PLY."""

from pathlib import Path

import numpy as np

from ..errors import InputError
from ..types import Mesh
from .atomic import atomic_path


def load_mesh(path: Path | str) -> Mesh:
    """Return the mesh of an OBJ or a PLY file, larger faces split into triangles.

    Vertices keep their order and number: where texture coordinates differ on two sides
    of an edge, the surface stays closed.

    Args:
        path: The file.

    Raises:
        InputError: If there is none, it is damaged, or it holds no triangle.
    """
    path = Path(path)
    readers = {".obj": read_obj, ".ply": read_ply}
    if path.suffix.lower() not in readers:
        raise InputError(f"'{path}' is not a mesh; give an .obj or a .ply file.")
    if not path.is_file():
        raise InputError(f"there is no mesh '{path}'; check the path.")
    mesh = readers[path.suffix.lower()](path)
    if len(mesh.faces) == 0:
        raise InputError(f"the mesh '{path}' has no face; export it again.")
    if mesh.faces.min() < 0 or mesh.faces.max() >= len(mesh.vertices):
        raise InputError(
            f"the mesh '{path}' has a face with a vertex that is not there (it has "
            f"{len(mesh.vertices)}); export it again."
        )
    if not np.isfinite(mesh.vertices).all():
        raise InputError(
            f"the mesh '{path}' has vertices that are not finite numbers; export it "
            "again."
        )
    return mesh


def save_mesh(path: Path | str, mesh: Mesh) -> None:
    """Write a mesh to an OBJ or a PLY file.

    Args:
        path: The file; its suffix says which format.
        mesh: The mesh; coordinates are written as float32.

    Raises:
        InputError: If the suffix is another.
    """
    path = Path(path)
    if path.suffix.lower() == ".obj":
        # Nine digits tell any two float32 apart.
        vertices = mesh.vertices.astype(np.float32)
        lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices.tolist()]
        lines += [f"f {a} {b} {c}" for a, b, c in (mesh.faces + 1).tolist()]
        content = ("\n".join(lines) + "\n").encode()
    elif path.suffix.lower() == ".ply":
        content = encode_ply(mesh)
    else:
        raise InputError(f"meshes are saved as .obj or .ply, not as '{path.name}'.")
    with atomic_path(path) as new:
        new.write_bytes(content)


def read_obj(path: Path) -> Mesh:
    """Return the `v` and `f` lines of an OBJ file.

    Not by trimesh: it doubles vertices along the seams of textures.
    """
    vertices: list[list[float]] = []
    faces: list[tuple[int, int, int]] = []
    for number, line in enumerate(obj_lines(path), 1):
        word, *rest = line.split() or [""]
        try:
            if word == "v":
                x, y, z = rest[:3]
                vertices.append([float(x), float(y), float(z)])
            elif word == "f":
                corner = [int(item.split("/")[0]) for item in rest]
                # Indices start at 1; negative ones count back from the last vertex.
                corner = [i - 1 if i > 0 else len(vertices) + i for i in corner]
                if len(corner) < 3 or min(corner) < 0:
                    raise ValueError
                faces += [
                    (corner[0], b, c)
                    for b, c in zip(corner[1:-1], corner[2:], strict=True)
                ]
        except ValueError as error:
            raise InputError(
                f"the mesh '{path}' is damaged in line {number}; export it again."
            ) from error
    return Mesh(
        np.array(vertices, np.float64).reshape(-1, 3),
        np.array(faces, np.int64).reshape(-1, 3),
    )


def obj_lines(path: Path) -> list[str]:
    """Return the lines of a text file, those that end in a backslash joined."""
    try:
        text = path.read_text(encoding="utf-8", errors="strict")
    except UnicodeDecodeError:
        # Old exporters write names of materials in their own code page.
        text = path.read_text(encoding="latin-1")
    return text.replace("\\\r\n", " ").replace("\\\n", " ").splitlines()


def read_ply(path: Path) -> Mesh:
    """Return the mesh of a PLY file."""
    import trimesh

    try:
        mesh = trimesh.load_mesh(path, process=False)
        vertices = np.asarray(mesh.vertices, np.float64).reshape(-1, 3)
        faces = np.asarray(getattr(mesh, "faces", ()), np.int64).reshape(-1, 3)
    except Exception as error:  # trimesh raises whatever its parser stumbles over
        raise InputError(
            f"the mesh '{path}' is damaged or no PLY file; export it again."
        ) from error
    return Mesh(vertices, faces)


def encode_ply(mesh: Mesh) -> bytes:
    """Return the content of a binary PLY file."""
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(mesh.vertices)}\n"
        "property float x\nproperty float y\nproperty float z\n"
        f"element face {len(mesh.faces)}\n"
        "property list uchar int vertex_indices\nend_header\n"
    )
    rows = np.empty(len(mesh.faces), [("count", "u1"), ("corner", "<i4", (3,))])
    rows["count"], rows["corner"] = 3, mesh.faces
    return header.encode() + mesh.vertices.astype("<f4").tobytes() + rows.tobytes()
