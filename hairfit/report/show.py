"""What a result looks like: its previews and its report."""

import dataclasses
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, UInt8

from ..abreast import abreast
from ..capture.capture import Capture, View
from ..capture.orientation import OrientationMap
from ..capture.photos import encode_picture
from ..evaluate.photographs import (
    PhotographErrors,
    compare_with_photograph,
    draw_in,
)
from ..evaluate.visibility import Sight, even_strands
from ..fit import FitResult
from ..fit.appearance import Appearance
from ..render.camera import Camera, resized
from ..render.scene import Background, Scene
from ..render.studio import preview_scene
from .certainty import certainty_pictures
from .drawing import draw_opaque, draw_preview, orbit_cameras
from .engines import Shot
from .html import HEIGHTS, ViewPage, report_html
from .pictures import (
    exposed,
    hair_window,
    orientation_picture,
    overlay_picture,
    photo_picture,
)

# So many strands are drawn, wider if there are more: small pictures look the same.
DRAWN = 10_000
# Metres, half a pixel or less: a hair that is wider is drawn as several side by side.
WIDEST = 0.00045
# Metres, less than a pixel of these pictures: how far knots may be that are left out.
WITHIN = 0.0008
FEWEST_KNOTS = 8
# Pictures of the turntable, by quality: each takes 0.2 s on two cores.
TURNS = {"draft": 8, "normal": 16, "high": 16}
PAPER = 0.25  # linear brightness of what is behind photographs drawn again
TURNTABLE_SIZE = (360, 450)


def show_result(folder: Path, capture: Capture, fitted: FitResult) -> dict[str, Any]:
    """Write `preview/` and `report.html`, and return the figures of each photograph."""
    points = even_strands(fitted.strands)
    previews = folder / "preview"
    previews.mkdir()
    sights = map(Sight, fitted.views, fitted.depths)
    step = -(-len(points) // DRAWN)
    some, owner = with_few_knots(points[::step], WITHIN), fitted.owner[::step]
    cameras = [small(view.camera) for view in fitted.views]
    count = TURNS[fitted.figures["quality"]]
    turns = orbit_cameras(points, count, TURNTABLE_SIZE)
    scene = preview_scene(some, capture.head)
    if fitted.looks is None:
        again = draw_preview(scene, cameras)
    else:
        look = fitted.looks.look(len(some))
        look = dataclasses.replace(look, width=min(look.width, WIDEST))
        scene = dataclasses.replace(scene, look=look)
        again = draw_again(scene, fitted.looks, cameras)
    frames = draw_preview(scene, turns)
    compared = abreast(partial(page_of, points), sights, fitted.maps, again)
    pages, errors = zip(*compared, strict=True)
    sure = certainty_pictures(scene, owner, fitted.tree.confidence)
    photographs = {one.name: one.to_dict() for one in errors}
    names = [page.name for page in pages]
    names += [f"turntable-{k:02}" for k in range(len(frames))]
    names += [f"certainty-{k:02}" for k in range(len(sure))]
    for name, picture in zip(names, [*again, *frames, *sure], strict=True):
        (previews / f"{name}.png").write_bytes(encode_picture(picture, ".png"))
    title = f"{capture.folder.resolve().name}, recovered from {len(pages)} photographs"
    warnings = [doubt.sentence for doubt in fitted.doubts]
    text = report_html(title, pages, fitted.figures, frames, warnings, sure)
    (folder / "report.html").write_text(text, encoding="utf-8")
    return photographs


def with_few_knots(
    points: Float[np.ndarray, "strands knots 3"], within: float
) -> Float[np.ndarray, "strands fewer 3"]:
    """Return strands without every other knot, as often as pictures do not show it.

    Args:
        points: Strands, in metres.
        within: How far from the line between its neighbours a knot may be that is left
            out, in metres: that of nineteen in twenty.
    """
    while points.shape[1] > FEWEST_KNOTS:
        start, chord = points[:, :-2:2], points[:, 2::2] - points[:, :-2:2]
        away = points[:, 1:-1:2] - start
        square = np.maximum((chord**2).sum(-1), 1e-18)
        share = np.clip((away * chord).sum(-1) / square, 0.0, 1.0)
        off = np.linalg.norm(away - share[..., None] * chord, axis=-1)
        if np.quantile(off, 0.95) > within:
            break
        points = np.concatenate([points[:, :-1:2], points[:, -1:]], axis=1)
    return points


def draw_again(
    scene: Scene, looks: Appearance, cameras: Sequence[Camera]
) -> list[UInt8[np.ndarray, "height width 3"]]:
    """Return the photographs drawn again: in their light, as bright as each was."""
    sky, skin = (looks.sky,) * 3, looks.skin or scene.skin
    lit = dataclasses.replace(scene, lights=looks.lights, sky=sky, skin=skin)
    gains = [float(gain) for gain in looks.exposure]
    paper = [Background((PAPER / gain, PAPER / gain, PAPER / gain)) for gain in gains]
    shots = [Shot("again", *one) for one in zip(cameras, paper, strict=True)]
    pictures = draw_opaque(lit, shots, None)
    return [exposed(*one) for one in zip(pictures, gains, strict=True)]


def window_of(
    view: View, picture: UInt8[np.ndarray, "height width 3"]
) -> tuple[slice, slice]:
    """Return the part of a smaller picture that a report shows of a photograph."""
    share = picture.shape[0] / view.camera.height
    rows, columns = (
        slice(round(share * part.start), round(share * part.stop))
        for part in hair_window(view.hair)
    )
    return rows, columns


class Compared(NamedTuple):
    """What a report shows of one photograph, and how strands fit it."""

    page: ViewPage
    errors: PhotographErrors


def page_of(
    points: Float[np.ndarray, "strands knots 3"],
    sight: Sight,
    found: OrientationMap,
    again: UInt8[np.ndarray, "height width 3"],
) -> Compared:
    """Return what a report shows of one photograph, and of it drawn again."""
    view = sight.view
    drawn = draw_in(points, sight)
    errors = compare_with_photograph(points, sight, found=found, drawn=drawn)
    window = hair_window(view.hair)
    page = ViewPage(
        view.name,
        photo_picture(view)[window],
        orientation_picture(found, view.hair)[window],
        overlay_picture(view, drawn.thin)[window],
        in_words(errors),
        again[window_of(view, again)],
    )
    return Compared(page, errors)


def small(camera: Camera) -> Camera:
    """Return a camera that takes pictures no higher than a report shows them."""
    share = min(1.0, HEIGHTS[0] / camera.height)
    return resized(camera, round(share * camera.width), round(share * camera.height))


def in_words(errors: PhotographErrors) -> dict[str, str]:
    """Return the figures of one photograph as the report shows them."""
    angle = errors.median_angle_deg
    return {
        "median angle error": "unknown" if angle is None else f"{angle:.1f}°",
        "overlap with the mask": f"{100 * errors.iou:.1f} %",
    }
