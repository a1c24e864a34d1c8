"""Captures of known hair: photographs, masks and cameras, and the truth beside them."""

import dataclasses
import hashlib
import json
import shutil
from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..errors import InputError
from ..io.mesh import save_mesh
from ..io.tree import save_tree
from ..model import HairTree, sample_strands
from ..render import Camera
from ..types import Mesh, Strands
from .picture import Look, Picture, make_lighting, take_picture
from .png import save_png

RING = 8
FILL = 0.62
CHECKSUMS = "SHA256SUMS"


@dataclasses.dataclass(frozen=True)
class Scene:
    """What is photographed, and how often.

    Attributes:
        views: Number of photographs. The first 8 (or all, if fewer) stand on a ring,
            the next ones on a higher ring.
        size: Width and height of a photograph, in pixels.
        strands: Number of strands.
        points: Points of each strand.
        seed: Seed of the roots and of the sensor's noise.
        distance: From the cameras to the middle of the hair, in metres.
        look: Colours and lights.
    """

    views: int = 8
    size: tuple[int, int] = (480, 640)
    strands: int = 6000
    points: int = 64
    seed: int = 0
    distance: float = 1.1
    look: Look = Look()

    def __post_init__(self):
        """Refuse what cannot be photographed."""
        for name, least in (("views", 1), ("strands", 1), ("points", 4)):
            if getattr(self, name) < least:
                raise InputError(
                    f"`{name}` of a synthetic capture must be at least {least}, got "
                    f"{getattr(self, name)}."
                )
        if min(self.size) < 16:
            raise InputError(
                f"pictures must be at least 16 pixels wide and high, got {self.size}."
            )


def write_capture(
    tree: HairTree,
    head: Mesh,
    folder: Path,
    scene: Scene = Scene(),
    *,
    progress: Callable[[str, float], None] = lambda step, share: None,
) -> None:
    """Write a capture of a hair tree: what a photographer would have, and the truth.

    The folder appears at the end, complete. The same tree and scene give the same
    bytes.

    Args:
        tree: The hair.
        head: The head.
        folder: Where to write; it must not exist, or be empty.
        scene: How it is photographed.
        progress: Called with what is done and the share that is done.

    Raises:
        InputError: If there is something in the folder already.
    """
    folder = Path(folder)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(
            f"'{folder}' is not empty; name a folder that does not exist yet."
        )
    partial = folder.with_name(folder.name + ".partial")
    shutil.rmtree(partial, ignore_errors=True)
    try:
        write_files(tree, head, partial, scene, progress)
        if folder.exists():
            folder.rmdir()
        partial.rename(folder)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def write_files(tree, head: Mesh, folder: Path, scene: Scene, progress) -> None:
    """Write all files of a capture, the checksums last."""
    for name in ("images", "masks/hair", "masks/body"):
        (folder / name).mkdir(parents=True)
    progress("hair", 0.0)
    points = scene_strands(tree, scene)
    cameras = scene_cameras(points, scene)
    lighting = make_lighting(points, scene.look)
    for i, camera in enumerate(cameras):
        progress("photographs", (i + 1) / (len(cameras) + 1))
        write_view(photograph(points, head, camera, lighting, scene, i), folder, i)
    write_cameras(cameras, folder / "cameras.json")
    save_mesh(folder / "head.obj", head)
    strands = Strands.from_array(points)
    np.savez_compressed(
        folder / "truth.npz", points=strands.points, offsets=strands.offsets
    )
    save_tree(folder / "tree.hairtree", tree, exact=True)
    write_checksums(folder)
    progress("done", 1.0)


def scene_strands(tree: HairTree, scene: Scene) -> Float[np.ndarray, "strands knots 3"]:
    """Return the strands of a scene, rounded to 10 micrometres.

    They are grown in float64: after rounding they are the same on every machine, and
    so are the pictures.
    """
    with jax.enable_x64(True):
        exact = jax.tree.map(lambda x: jnp.asarray(x, jnp.float64), tree)
        key = jax.random.key(scene.seed)
        points = sample_strands(exact, scene.strands, scene.points, key)
        return np.round(np.asarray(points, np.float64), 5)


def scene_cameras(
    points: Float[np.ndarray, "strands knots 3"], scene: Scene
) -> list[Camera]:
    """Return cameras around the hair, the first one before the face.

    The ring is 8 degrees above the hair's middle, the higher ring 42. All have the
    focal length that lets the hair fill 62 % of the height.
    """
    low, high = points.min((0, 1)), points.max((0, 1))
    centre = np.round(0.5 * (low + high), 4)
    width, height = scene.size
    tall = max(high[1] - low[1], (high[0] - low[0]) * height / width * 0.9)
    focal = round(float(FILL * height * scene.distance / tall), 2)
    K = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1.0]])
    ring = min(scene.views, RING)
    upper = scene.views - ring
    places = [(2 * np.pi * i / ring, np.radians(8)) for i in range(ring)]
    places += [(2 * np.pi * (i + 0.5) / upper, np.radians(42)) for i in range(upper)]
    cameras = []
    for azimuth, elevation in places:
        level = np.cos(elevation)
        out = [level * np.sin(azimuth), np.sin(elevation), level * np.cos(azimuth)]
        eye = centre + scene.distance * np.array(out)
        view = np.round(looking_at(eye, centre), 9)
        with jax.enable_x64(True):
            cameras.append(Camera(jnp.asarray(K), jnp.asarray(view), width, height))
    return cameras


def looking_at(
    eye: Float[np.ndarray, " 3"], target: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, "4 4"]:
    """Return `cam_from_world` of a camera that stands upright and looks at a point."""
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    view = np.eye(4)
    view[:3, :3] = right, np.cross(forward, right), forward
    view[:3, 3] = -view[:3, :3] @ eye
    return view


def photograph(points, head: Mesh, camera, lighting, scene: Scene, i: int) -> Picture:
    """Return view `i` of a scene; each view has noise of its own."""
    rng = np.random.default_rng((scene.seed, i))
    return take_picture(points, head, camera, lighting, scene.look, rng)


def write_view(picture: Picture, folder: Path, i: int) -> None:
    """Write a photograph and its masks."""
    name = f"{i:02d}.png"
    save_png(folder / "images" / name, picture.image)
    for kind, mask in (("hair", picture.hair), ("body", picture.body)):
        save_png(folder / "masks" / kind / name, np.where(mask, 255, 0).astype("u1"))


def write_cameras(cameras: list[Camera], path: Path) -> None:
    """Write `cameras.json`, one view a line."""
    views = [
        json.dumps(
            {
                "name": f"{i:02d}.png",
                "width": camera.width,
                "height": camera.height,
                "K": np.asarray(camera.K).tolist(),
                "cam_from_world": np.asarray(camera.cam_from_world).tolist(),
            }
        )
        for i, camera in enumerate(cameras)
    ]
    path.write_text('{"views": [\n' + ",\n".join(views) + "\n]}\n", encoding="utf-8")


def write_checksums(folder: Path) -> None:
    """Write the checksums of all files of a folder, as `sha256sum -c` reads them."""
    files = sorted(p for p in folder.rglob("*") if p.is_file() and p.name != CHECKSUMS)
    lines = [f"{checksum(p)}  {p.relative_to(folder).as_posix()}" for p in files]
    (folder / CHECKSUMS).write_text("\n".join(lines) + "\n", encoding="utf-8")


def checksum(path: Path) -> str:
    """Return the SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()
