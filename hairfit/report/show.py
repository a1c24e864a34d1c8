"""What a result looks like: its previews and its report."""

from pathlib import Path
from typing import Any

from ..capture.capture import Capture
from ..capture.photos import encode_picture
from ..evaluate.photographs import PhotographErrors, compare_with_photograph
from ..evaluate.visibility import even_strands, look
from ..fit import FitResult
from ..render.raster import rasterise
from .certainty import certainty_pictures
from .drawing import draw_hair, orbit_cameras
from .html import ViewPage, report_html
from .pictures import (
    hair_window,
    orientation_picture,
    overlay_picture,
    photo_picture,
)

# So many strands are drawn, wider if there are more: small pictures look the same.
DRAWN = 6000
TURNS = 16
TURNTABLE_SIZE = (360, 450)


def show_result(folder: Path, capture: Capture, fitted: FitResult) -> dict[str, Any]:
    """Write `preview/` and `report.html`, and return the figures of each photograph."""
    points = even_strands(fitted.strands)
    previews = folder / "preview"
    previews.mkdir()
    pages, photographs = [], {}
    views = fitted.views
    for sight, found in zip(look(capture.head, views), fitted.maps, strict=True):
        view = sight.view
        raster = rasterise(points, view.camera, mesh_depth=sight.behind)
        errors = compare_with_photograph(points, sight, found=found, drawn=raster)
        photographs[view.name] = errors.to_dict()
        window = hair_window(view.hair)
        pages.append(
            ViewPage(
                view.name,
                photo_picture(view)[window],
                orientation_picture(found, view.hair)[window],
                overlay_picture(view, raster)[window],
                in_words(errors),
            )
        )
    cameras = [view.camera for view in views]
    turns = orbit_cameras(points, TURNS, TURNTABLE_SIZE)
    some = points[:: -(-len(points) // DRAWN)]
    drawn = draw_hair(some, capture.head, [*cameras, *turns])
    frames = drawn[len(cameras) :]
    names = [page.name for page in pages]
    names += [f"turntable-{k:02}" for k in range(len(frames))]
    sure = certainty_pictures(fitted.tree, capture.head)
    names += [f"certainty-{k:02}" for k in range(len(sure))]
    for name, picture in zip(names, [*drawn, *sure], strict=True):
        (previews / f"{name}.png").write_bytes(encode_picture(picture, ".png"))
    title = f"{capture.folder.resolve().name}, recovered from {len(pages)} photographs"
    warnings = [doubt.sentence for doubt in fitted.doubts]
    text = report_html(title, pages, fitted.figures, frames, warnings, sure)
    (folder / "report.html").write_text(text, encoding="utf-8")
    return photographs


def in_words(errors: PhotographErrors) -> dict[str, str]:
    """Return the figures of one photograph as the report shows them."""
    angle = errors.median_angle_deg
    return {
        "median angle error": "unknown" if angle is None else f"{angle:.1f}°",
        "overlap with the mask": f"{100 * errors.iou:.1f} %",
    }
