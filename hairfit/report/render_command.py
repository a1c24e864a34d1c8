"""`hairfit render`: pictures of hair as they were asked for [Kim02, section 6.1]."""

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, UInt8

from ..capture.cameras import CameraEntry, read_cameras
from ..capture.head import load_head
from ..capture.photos import read_photo, stem
from ..errors import InputError
from ..evaluate.visibility import even_strands
from ..io.mesh import load_mesh
from ..render.camera import Camera, resized
from ..types import Mesh
from .behind import Backdrops
from .engines import Shot, draw_shots, open_engine
from .film import check_film, open_film
from .hairstyles import must_exist, own_colour, own_width, read_strands
from .line_drawing import line_drawing
from .orbit import orbit_camera, orbit_cameras
from .progress import Progress, shown_progress
from .render_options import BackgroundOptions, CameraOptions, RenderOptions
from .render_scene import (
    check_options,
    make_scene,
    moving_lights,
    parse_colour,
    still,
    style_of,
)
from .result import captured_from, is_result

SIZE = (768, 960)
SMALLEST, LARGEST = 16, 8192
MOST_TURNS = 10_000
ALL = "all"


class Subject(NamedTuple):
    """What is drawn, and who took its photographs.

    Attributes:
        points: The hair, in metres.
        head: What wears it, or None.
        capture: The folder of the photographs, or None.
        entries: Their cameras.
    """

    points: Float[np.ndarray, "strands knots 3"]
    head: Mesh | None
    capture: Path | None
    entries: tuple[CameraEntry, ...]


def render(
    hair: Path,
    out: Path,
    options: RenderOptions,
    *,
    capture: Path | None = None,
    head: Path | None = None,
) -> dict[str, Any]:
    """Write pictures of a hairstyle, and return what was written.

    Args:
        hair: A result, a tree or strands.
        out: A PNG; for several pictures a folder, a GIF or an MP4.
        options: What was asked for.
        capture: The capture whose head and cameras are used; a result knows its own.
        head: A mesh of the head, in place of the capture's.

    Raises:
        InputError: If something cannot be read, drawn or written.
    """
    check_options(options)
    check_cameras(options.camera, out)
    if options.background.transparent and out.suffix.lower() in (".gif", ".mp4"):
        raise InputError(
            "--transparent needs PNG, as GIF and MP4 have no alpha; name a folder."
        )
    subject = read_subject(hair, capture, head, options.hair.strands)
    own = options.hair
    if own.colour is None and own.melanin is None:
        own = dataclasses.replace(own, colour=own_colour(hair))
    if own.width_mm is None:
        width = own_width(hair, len(subject.points))
        own = dataclasses.replace(own, width_mm=width and 1000.0 * width)
    options = dataclasses.replace(options, hair=own)
    shots = find_shots(subject, options)
    for shot in shots:
        check_size(shot.camera)
    channels = 4 if options.background.transparent else 3
    with (
        shown_progress(quiet=options.quiet) as progress,
        open_film(out, [shot.name for shot in shots]) as write,
    ):
        draws = Draws(subject, shots, options, progress)
        for picture in draws.by_pen() if options.lines else draws.by_engine():
            write(np.ascontiguousarray(picture[..., :channels]))
    camera = shots[0].camera
    return {
        "out": str(out),
        "pictures": len(shots),
        "size": [camera.width, camera.height],
        "engine": draws.engine,
    }


@dataclasses.dataclass
class Draws:
    """Draws the shots of a subject.

    Attributes:
        subject: What is drawn.
        shots: From where.
        options: What was asked for.
        progress: Takes what is done, and the share of all.
        engine: What drew them.
    """

    subject: Subject
    shots: list[Shot]
    options: RenderOptions
    progress: Progress
    engine: str = "pen"

    def by_engine(self) -> Iterator[UInt8[np.ndarray, "height width 4"]]:
        """Yield the pictures as OpenGL or JAX draws them."""
        options = self.options
        scene = make_scene(self.subject.points, self.subject.head, options)
        lights_of = moving_lights(options, scene)
        with open_engine(
            still(scene, lights_of),
            options.engine,
            style_of(options.quality),
            quiet=options.quiet,
        ) as engine:
            self.engine = engine.name
            backdrops = Backdrops(
                options.background,
                self.subject.capture,
                self.subject.entries,
                self.subject.head,
            )
            shots = backdrops.put(self.shots)
            count = len(self.shots)
            yield from draw_shots(engine, shots, count, lights_of, self.progress)

    def by_pen(self) -> Iterator[UInt8[np.ndarray, "height width 4"]]:
        """Yield the pictures as pen and ink draw them."""
        plain = dataclasses.replace(self.options.hair, shading="kajiya-kay")
        options = dataclasses.replace(self.options, hair=plain)
        scene = make_scene(self.subject.points, self.subject.head, options)
        lights_of = moving_lights(options, scene)
        paper = None
        if self.options.background.background is not None:
            paper = parse_colour(self.options.background.background, "--background")
        for k, shot in enumerate(self.shots):
            self.progress("drawing", k / len(self.shots))
            lights = scene.lights if lights_of is None else lights_of(shot.camera)
            lit = dataclasses.replace(scene, lights=lights)
            yield line_drawing(lit, shot.camera, paper=paper)
        self.progress("drawing", 1.0)


def check_cameras(asked: CameraOptions, out: Path) -> None:
    """Refuse cameras that exclude each other, and a place that cannot hold pictures."""
    several: int | None = None
    if asked.turntable is not None:
        if asked.view is not None:
            raise InputError("--view and --turntable exclude each other; give one.")
        if not 2 <= asked.turntable <= MOST_TURNS:
            raise InputError(
                f"--turntable must be from 2 to {MOST_TURNS}, not {asked.turntable}."
            )
        several = asked.turntable
    if asked.view is None and asked.scale != 1.0:
        raise InputError("--scale enlarges a photograph's size; give --view or --size.")
    if asked.view is not None and asked.size is not None:
        raise InputError("--view has the photograph's size; give --scale, not --size.")
    if not 0.0 < asked.scale <= 1e3:
        raise InputError(f"--scale must be above 0, not {asked.scale:g}.")
    if asked.view == ALL:
        if out.suffix.lower() in (".gif", ".mp4", ".png"):
            raise InputError(
                f"--out '{out}' must be a folder for --view {ALL}; rename it."
            )
        several = 2
    check_film(out, several)


def check_size(camera: Camera) -> None:
    """Refuse pictures that are too small or too large."""
    if not all(SMALLEST <= x <= LARGEST for x in (camera.width, camera.height)):
        raise InputError(
            f"a picture of {camera.width} x {camera.height} pixels cannot be drawn; "
            f"choose --size or --scale so that each is from {SMALLEST} to {LARGEST}."
        )


def read_subject(
    hair: Path, capture: Path | None, head: Path | None, strands: int
) -> Subject:
    """Return the hair, the head and the photographs' cameras."""
    must_exist(hair)
    points = even_strands(read_strands(hair, count=strands))
    if capture is None and is_result(hair):
        capture = captured_from(hair)
    entries: tuple[CameraEntry, ...] = ()
    mesh = None if head is None else load_mesh(head)
    if capture is not None:
        must_exist(capture)
        entries = read_cameras(capture / "cameras.json")
        if mesh is None and (capture / "head.obj").exists():
            mesh = load_head(capture / "head.obj", entries)
    return Subject(points, mesh, capture, entries)


def find_shots(subject: Subject, options: RenderOptions) -> list[Shot]:
    """Return what is drawn from where."""
    asked = options.camera
    if asked.view is not None:
        entries = entries_named(asked.view, subject.entries, subject.capture)
        return [Shot(one.name, scaled(one.camera, asked.scale)) for one in entries]
    size = asked.size or size_behind(options.background)
    if not all(SMALLEST <= x <= LARGEST for x in size):
        raise InputError(
            f"--size must be from {SMALLEST} to {LARGEST} pixels, not {size[0]} "
            f"{size[1]}."
        )
    if asked.turntable is not None:
        cameras = orbit_cameras(subject.points, asked.turntable, size, asked.elevation)
        return [Shot(f"frame-{k:04}", camera) for k, camera in enumerate(cameras)]
    azimuth, elevation = np.radians([asked.azimuth, asked.elevation])
    camera = orbit_camera(subject.points, float(azimuth), float(elevation), size)
    return [Shot("picture", camera)]


def size_behind(asked: BackgroundOptions) -> tuple[int, int]:
    """Return the size that a picture has if none is asked for."""
    if asked.behind is None:
        return SIZE
    height, width = read_photo(asked.behind).shape[:2]
    return width, height


def entries_named(
    view: str, entries: tuple[CameraEntry, ...], capture: Path | None
) -> tuple[CameraEntry, ...]:
    """Return the cameras of a photograph, or of all of them."""
    if capture is None:
        raise InputError(
            f"--view {view} needs the capture with that photograph; name it with "
            "--capture."
        )
    cameras = {entry.name: entry for entry in entries}
    if stem(view) in cameras:
        return (cameras[stem(view)],)
    if view == ALL:
        return entries
    raise InputError(f"no view '{view}'; the capture has {', '.join(cameras)}.")


def scaled(camera: Camera, scale: float) -> Camera:
    """Return a camera with so many times the pixels along each side."""
    return resized(camera, round(scale * camera.width), round(scale * camera.height))
