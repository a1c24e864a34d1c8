"""A capture small enough to be made anew by every test that spoils it."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import trimesh

WIDTH, HEIGHT = 48, 64
NAMES = ("00", "01", "02")


def look_at_head(azimuth: float, distance: float = 1.0) -> np.ndarray:
    """Return `cam_from_world` of a camera that looks at the origin from an azimuth."""
    backwards = np.array([np.sin(azimuth), 0.0, np.cos(azimuth)])
    down = np.array([0.0, -1.0, 0.0])
    rotation = np.stack([np.cross(down, -backwards), down, -backwards])
    cam_from_world = np.eye(4)
    cam_from_world[:3, :3] = rotation
    cam_from_world[:3, 3] = [0.0, 0.0, distance]
    return cam_from_world


def camera_entry(name: str, azimuth: float) -> dict[str, Any]:
    """Return one entry of `cameras.json`."""
    focal = 250.0
    return {
        "name": f"{name}.png",
        "width": WIDTH,
        "height": HEIGHT,
        "K": [[focal, 0, WIDTH / 2], [0, focal, HEIGHT / 2], [0, 0, 1]],
        "cam_from_world": look_at_head(azimuth).tolist(),
    }


def write_tiny_capture(folder: Path) -> Path:
    """Write three views of a ball that wears a cap of hair, and return the folder."""
    for part in ("images", "masks/hair", "masks/body"):
        (folder / part).mkdir(parents=True)
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.1)
    ball.export(folder / "head.obj")
    y, x = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    disc = (x - WIDTH / 2) ** 2 + (y - HEIGHT / 2) ** 2 < 24**2
    hair, body = disc & (y < HEIGHT / 2), disc & (y >= HEIGHT / 2)
    picture = np.full((HEIGHT, WIDTH, 3), 180, np.uint8)
    picture[disc] = (90, 120, 200)
    picture[hair] = (20, 40, 60)
    views = []
    for k, name in enumerate(NAMES):
        cv2.imwrite(str(folder / f"images/{name}.png"), picture)
        cv2.imwrite(str(folder / f"masks/hair/{name}.png"), hair * np.uint8(255))
        cv2.imwrite(str(folder / f"masks/body/{name}.png"), body * np.uint8(255))
        views.append(camera_entry(name, 2 * np.pi * k / len(NAMES)))
    write_cameras(folder, views)
    return folder


def write_cameras(folder: Path, views: list[dict[str, Any]]) -> None:
    """Write `cameras.json`."""
    (folder / "cameras.json").write_text(json.dumps({"views": views}))


def read_cameras_json(folder: Path) -> list[dict[str, Any]]:
    """Return the entries of `cameras.json`, to be spoilt."""
    return json.loads((folder / "cameras.json").read_text())["views"]
