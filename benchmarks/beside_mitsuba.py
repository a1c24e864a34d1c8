"""Frames beside photographs by a path tracer, and its shadows beside opacity maps.

Run `python benchmarks/beside_mitsuba.py [--captures FOLDER] [--out FILE]`. Needs the
reference captures, whose photographs Mitsuba 3 took. Above: photographs, each with a
frame in the same light: the key light as a lamp, the sky as 14 far lights that hair and
head can shadow. Below, where `pip install hairfit[mitsuba]` and an LLVM are there
(`DRJIT_LIBLLVM_PATH` says where): the share of the light that reaches strands' vertices
by Mitsuba's rays and by opacity maps. Prints what the pictures show.
"""

import argparse
import pathlib
import tempfile

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float
from matplotlib.figure import Figure

from hairfit.capture.cameras import read_cameras
from hairfit.capture.head import load_head
from hairfit.capture.photos import linear_from_srgb, read_photo, srgb_from_linear
from hairfit.render.gl import Frames, open_context
from hairfit.render.gl.buffers import point_rows
from hairfit.render.gl.context import read
from hairfit.render.gl.shadows import ShadowMaps
from hairfit.render.lights import PointLight
from hairfit.render.pigment import PIGMENTS, chiang_look
from hairfit.render.scene import Background, Scene
from hairfit.render.shadow_style import ShadowStyle
from hairfit.render.studio import sky_lights
from hairfit.render.view import View, distant_view, light_axes, see_all

ROOT = pathlib.Path(__file__).parents[1]
CAPTURES = ROOT.parent / "shared" / "captures"
GROOMS = (("ruby", "brown"), ("ponytail", "red"))
VIEWS = (0, 2, 4)
# As the photographs were taken: a square lamp, and a sky.
WIDTH = 1.2e-4  # of a hair, in metres
LAMP, SIDE, RADIANCE = np.array([0.9, 1.3, 1.2]), 0.7, np.array([9.0, 8.64, 8.1])
SKY, SKIN = (0.35, 0.35, 0.35), (0.58, 0.42, 0.34)
TO_LIGHT = np.array([0.3, 0.8, 0.5])
POINTS, RAYS = 20_000, 64


def strands_of(capture: pathlib.Path) -> Float[np.ndarray, "strands 32 3"]:
    """Return the strands that were photographed."""
    with np.load(capture / "truth.npz") as truth:
        return truth["points"].reshape(-1, 32, 3).astype(np.float64)


def scene_of(capture: pathlib.Path, colour: str) -> Scene:
    """Return the scene that was photographed, but for its floor."""
    strands = strands_of(capture)
    flat = strands.reshape(-1, 3)
    place = 0.5 * (flat.min(0) + flat.max(0)) + LAMP
    # A small lamp of as much light; a white surface sends back 1 / pi of what it gets.
    lamp = PointLight(jnp.asarray(place), jnp.asarray(RADIANCE * SIDE**2 / np.pi))
    entries = read_cameras(capture / "cameras.json")
    return Scene(
        strands,
        look=chiang_look(PIGMENTS[colour], width=WIDTH, variation=0.0),
        head=load_head(capture / "head.obj", entries),
        skin=SKIN,
        lights=(lamp, *sky_lights(SKY)),
        sky=(0.0, 0.0, 0.0),
        background=Background(colour=SKY),
    )


def around(mask: Bool[np.ndarray, "height width"]) -> tuple[slice, slice]:
    """Return the rows and columns that hold hair and what is about it."""
    row, column = np.nonzero(mask)
    height, middle = row.max() - row.min() + 100, (column.min() + column.max()) // 2
    first = max(int(row.min()) - 40, 0)
    left = max(middle - int(0.45 * height), 0)
    return slice(first, first + height), slice(left, left + int(0.9 * height))


def draw_pairs(axes, capture: pathlib.Path, colour: str) -> None:
    """Draw photographs and frames, and print how bright hair is in them."""
    entries = read_cameras(capture / "cameras.json")
    context = open_context()
    frames = Frames(context, scene_of(capture, colour))
    for k, view in enumerate(VIEWS):
        name = entries[view].name
        photo = read_photo(capture / "images" / f"{name}.png")
        shown = frames.draw(entries[view].camera)[..., :3]
        frame = linear_from_srgb(shown / 255.0)
        mask = read_photo(capture / "masks" / "hair" / f"{name}.png")[..., 0] > 0.5
        means = [
            " ".join(f"{x:.4f}" for x in picture[mask].mean(0))
            for picture in (photo, frame)
        ]
        ratio = frame[mask].mean() / photo[mask].mean()
        print(f"| {capture.name} {name} | {means[0]} | {means[1]} | {ratio:.2f} |")
        part = around(mask)
        pair = ("Mitsuba", srgb_from_linear(photo)), ("hairfit", shown)
        for j, (title, picture) in enumerate(pair):
            axes[2 * k + j].imshow(picture[part])
            axes[2 * k + j].set_title(f"{capture.name} {name}, {title}", fontsize=8)
            axes[2 * k + j].axis("off")
    context.release()


def by_rays(
    strands: Float[np.ndarray, "strands 32 3"],
    at: Float[np.ndarray, "points 3"],
    texel: float,
) -> Float[np.ndarray, " points"]:
    """Return the share of Mitsuba's rays that reach the light from about points.

    Rays start in a tent one texel wide across the light, as a map is looked up.
    """
    import mitsuba as mi  # pyright: ignore[reportMissingImports]

    mi.set_variant("llvm_ad_rgb")
    with tempfile.NamedTemporaryFile("w", suffix=".txt") as file:
        for strand in strands:
            rows = "\n".join(
                f"{x:.6f} {y:.6f} {z:.6f} {WIDTH / 2}" for x, y, z in strand
            )
            file.write(rows + "\n\n")
        file.flush()
        hair = {"type": "linearcurve", "filename": file.name}
        scene = mi.load_dict({"type": "scene", "hair": hair})
    rng = np.random.default_rng(0)
    off = texel * rng.uniform(-0.5, 0.5, (2, len(at), RAYS, 2)).sum(0)
    right, down, away = light_axes(TO_LIGHT)
    start = at[:, None] + off[..., :1] * right + off[..., 1:] * down
    start = (start - 1.25 * WIDTH * away).reshape(-1, 3).T.astype(np.float32)
    way = mi.Vector3f(*(float(x) for x in -away))
    ray = mi.Ray3f(mi.Point3f(np.ascontiguousarray(start)), way)
    hit = np.asarray(scene.ray_test(ray))
    return 1.0 - hit.reshape(len(at), RAYS).mean(1)


def by_maps(
    strands: Float[np.ndarray, "strands 32 3"], view: View, style: ShadowStyle
) -> Float[np.ndarray, " points"]:
    """Return the share of the light that maps let through to all vertices."""
    flat = strands.reshape(-1, 3)
    context = open_context()
    points, out = (
        context.buffer(point_rows(strands, WIDTH)),
        context.buffer(reserve=8 * len(flat)),
    )
    maps = ShadowMaps(context, style)
    maps.build(points, len(flat), view, see_all(flat, view)[:, 2])
    maps.light(points, len(flat), out)
    opacity = read(out, np.float32, (len(flat), 2))[:, 0]
    context.release()
    return np.exp(-opacity)


def draw_shadows(axes, capture: pathlib.Path) -> None:
    """Draw maps against rays, and print how far they are apart."""
    strands = strands_of(capture)
    flat = strands.reshape(-1, 3)
    view = distant_view(TO_LIGHT, flat, 512)
    chosen = np.random.default_rng(0).choice(len(flat), POINTS, replace=False)
    rays = by_rays(strands, flat[chosen], 1.0 / float(view.pixels_per_metre))
    for axis, style in zip(
        axes, (ShadowStyle(), ShadowStyle(scheme="adaptive", slices=16)), strict=False
    ):
        maps = by_maps(strands, view, style)[chosen]
        rmse = float(np.sqrt(((maps - rays) ** 2).mean()))
        close = float(np.corrcoef(maps, rays)[0, 1])
        name = f"{capture.name}, {style.slices} {style.scheme}"
        print(
            f"| {name} | {maps.mean():.3f} | {rays.mean():.3f} | {rmse:.3f} | "
            f"{close:.3f} |"
        )
        axis.hist2d(rays, maps, 40, range=[[0, 1], [0, 1]], norm="log", cmap="Greys")
        axis.set_title(f"{name}, {style.size}²", fontsize=8)
        axis.set(xlabel="light by Mitsuba's rays", ylabel="by opacity maps")
        axis.set_aspect("equal")


def main(captures: pathlib.Path, out: pathlib.Path) -> None:
    """Draw the sheet and print the tables.

    Args:
        captures: The folder of reference captures.
        out: The JPEG.
    """
    if not captures.is_dir():
        raise SystemExit(f"no captures in {captures}; name them with --captures.")
    figure = Figure(figsize=(13.5, 8.2), dpi=110, layout="constrained")
    axes = figure.subplots(3, 6)
    print("| photograph | hair, Mitsuba (linear RGB) | hair, hairfit | ratio |")
    print("| --- | --- | --- | --- |")
    for row, (name, colour) in zip(axes, GROOMS, strict=False):
        draw_pairs(row, captures / name, colour)
    try:
        import mitsuba  # noqa: F401  # pyright: ignore[reportMissingImports]
    except ImportError:
        print("without Mitsuba, no shadows: pip install hairfit[mitsuba]")
    else:
        print("\n| maps | mean light | by rays | RMSE | correlation |")
        print("| --- | --- | --- | --- | --- |")
        for k, (name, _) in enumerate(GROOMS):
            draw_shadows(axes[2, 3 * k : 3 * k + 2], captures / name)
    for axis in axes.flat:
        if not axis.has_data():
            axis.axis("off")
    figure.savefig(out, pil_kwargs={"quality": 88})
    print(f"wrote {out}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--captures", type=pathlib.Path, default=CAPTURES)
    parser.add_argument(
        "--out", type=pathlib.Path, default=ROOT / "docs/pictures/beside_mitsuba.jpg"
    )
    given = parser.parse_args()
    main(given.captures, given.out)
