"""What rendering costs and how close it comes to references.

Run `python benchmarks/render.py [accuracy|shadows|frames|antialiasing|observe ...]`.
Ratios are of one run, times medians of 5; compiling is not counted. Scenes are made
here, and ruby and ponytail of the reference captures stand beside them where these are
there. Needs OpenGL 4.3; the frame of 1.6 million segments is drawn where OpenGL is not
Mesa's software.
"""

import argparse
import hashlib
import pathlib
import statistics
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from observe import make_camera, make_view, measure_observe
from strands import machine
from table_6_1 import Table61, Way

from hairfit.model import sample_strands
from hairfit.render import Camera
from hairfit.render.gl import Frames, FrameStyle, open_context
from hairfit.render.gl.buffers import point_rows
from hairfit.render.gl.context import read
from hairfit.render.gl.lines import HairLines
from hairfit.render.gl.passes import LineMaps
from hairfit.render.gl.shadows import ShadowMaps
from hairfit.render.lights import DistantLight
from hairfit.render.observe import Appearance, ObserveConfig, observe
from hairfit.render.opacity_exact import exact_lists
from hairfit.render.opacity_layers import layered_maps
from hairfit.render.opacity_lookup import opacity_at
from hairfit.render.opacity_maps import opacity_maps
from hairfit.render.opacity_occupied import occupied_maps
from hairfit.render.pieces import hair_pieces
from hairfit.render.scene import Background, HairLook, Scene
from hairfit.render.shadow_style import PREVIEW_SHADOWS, ShadowStyle
from hairfit.render.slices import uniform_slices
from hairfit.render.view import camera_view, distant_view, see_all
from hairfit.render.visibility import composite
from hairfit.report.drawing import orbit_camera
from hairfit.synthetic.gallery import make_gallery_tree, make_subject

CAPTURES = pathlib.Path(__file__).parents[2] / "shared" / "captures"
TO_LIGHT = np.array([0.3, 0.8, 0.5])
WIDTH = 8e-5
REPEATS = 5


class Groom(NamedTuple):
    """Hair to measure with.

    Attributes:
        name: What it is.
        strands: Its strands, in metres.
        width: Width of a hair.
    """

    name: str
    strands: Float[np.ndarray, "strands knots 3"]
    width: float


def make_groom(strands: int, knots: int = 33) -> Float[np.ndarray, "strands knots 3"]:
    """Return hair that leaves a ball upwards and outwards, waves and falls."""
    rng = np.random.default_rng(0)
    way = rng.normal(size=(strands, 1, 3))
    way[..., 1] = np.abs(way[..., 1])
    way /= np.linalg.norm(way, axis=-1, keepdims=True)
    t = np.linspace(0.0, 1.0, knots)[None, :, None]
    fall = np.array([0.0, -0.22, 0.0]) * rng.uniform(0.7, 1.0, (strands, 1, 1))
    wave = 0.004 * np.sin(20.0 * t + rng.uniform(0.0, 6.0, (strands, 1, 1)))
    side = np.array([0.06, 0.024, 0.06])
    hair = 0.1 * way + t * way * side + t**1.5 * fall
    hair = hair + wave * rng.normal(size=(strands, 1, 3))
    return hair.astype(np.float32).astype(np.float64)


def grooms() -> list[Groom]:
    """Return the scenes: made here, of the gallery, and of artists."""
    found = [
        Groom("dense", make_groom(10_000), WIDTH),
        Groom("sparse", make_groom(1_500), 4 * WIDTH),
    ]
    for name in ("bob", "afro"):
        tree = make_gallery_tree(name)
        hair = sample_strands(tree, 10_000, 33, jax.random.key(0))
        found.append(
            Groom(f"{name} of the gallery", np.asarray(hair, np.float64), WIDTH)
        )
    for name in ("ruby", "ponytail"):
        path = CAPTURES / name / "truth.npz"
        if path.exists():
            with np.load(path) as truth:
                strands = truth["points"].reshape(-1, 32, 3).astype(np.float64)
            found.append(Groom(name, strands, 1.2e-4))
    return found


def median_ms(function: Callable[[], Any], repeats: int = REPEATS) -> float:
    """Return the median time of a function, after a first run that is not counted."""
    times = []
    for _ in range(repeats + 1):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return 1e3 * statistics.median(times[1:])


def psnr(one: np.ndarray, other: np.ndarray) -> float:
    """Return how close pictures are, in dB; linear RGB, white is 1."""
    error = np.asarray(one, np.float64)[..., :3] - other[..., :3]
    return float(10.0 * np.log10(1.0 / np.maximum((error**2).mean(), 1e-12)))


class Maps:
    """Shadow maps of one groom and light, built and looked up at all vertices."""

    def __init__(self, context: Any, groom: Groom, style: ShadowStyle):
        self.context, self.count = (
            context,
            groom.strands.shape[0] * groom.strands.shape[1],
        )
        self.flat = groom.strands.reshape(-1, 3)
        self.view = distant_view(TO_LIGHT, self.flat, style.size)
        self.depth = see_all(self.flat, self.view)[:, 2]
        self.points = context.buffer(point_rows(groom.strands, groom.width))
        self.out = context.buffer(reserve=8 * self.count)
        self.maps = ShadowMaps(context, style)

    def run(self) -> None:
        """Build and look up."""
        self.maps.build(self.points, self.count, self.view, self.depth)
        self.maps.light(self.points, self.count, self.out)
        self.context.finish()

    def light(self) -> Float[np.ndarray, " points"]:
        """Return the share of light at the vertices."""
        self.run()
        return np.exp(-read(self.out, np.float32, (self.count, 2))[:, 0])

    def release(self) -> None:
        """Give the memory back."""
        for thing in (self.maps, self.points, self.out):
            thing.release()


def rmse(one: np.ndarray, other: np.ndarray) -> float:
    """Return the root of the mean square of the difference."""
    return float(np.sqrt(((one - other) ** 2).mean()))


def accuracy(context: Any) -> None:
    """Print how far maps are from NumPy's, and from exact lists."""
    print("\n## Opacity maps, 512 x 512, at all vertices\n")
    print("Largest difference of GL and float64, of 1/255; RMSE against exact lists.\n")
    print(
        "| scene | GL, uniform | GL, adaptive | RMSE of 64 uniform | 16 adaptive, times"
        " that | 16 even from first to last hair | deep opacity, 16 | other bits |"
    )
    print("| --- " * 8 + "|")
    even, layers = ShadowStyle(), ShadowStyle(scheme="adaptive", slices=16)
    for groom in grooms():
        found, memory = {}, {}
        for style in (even, layers):
            maps = Maps(context, groom, style)
            found[style], memory[style] = maps.light(), maps.maps.memory
            view, flat, depth = maps.view, maps.flat, maps.depth
            held = maps.maps.occupied() if style is layers else None
            maps.release()
        args = groom.strands, groom.width, view
        ends = float(depth.min()), float(depth.max())
        references = (
            opacity_maps(*args, uniform_slices(*ends, 64)),
            occupied_maps(*args, ends, 16, occupied=held),
        )
        own = occupied_maps(*args, ends, 16).occupied
        other_bits = (own != held).sum() / own.sum()
        off = [
            255.0 * np.abs(found[style] - np.exp(-opacity_at(one, flat))).max()
            for style, one in zip((even, layers), references, strict=True)
        ]
        exact = np.exp(-opacity_at(exact_lists(*args), flat))
        errors = [rmse(found[style], exact) for style in (even, layers)]
        # What others do: even layers from the first to the last hair, and deep opacity
        # maps, whose layers reach equally far behind the first hair.
        reach = 0.5 * (ends[1] - ends[0]) * np.arange(1, 17) / 16
        for other in (layered_maps(*args, 16), layered_maps(*args, 16, offsets=reach)):
            errors.append(rmse(np.exp(-opacity_at(other, flat)), exact))
        cells = " | ".join(f"{error / errors[0]:.2f}" for error in errors[1:])
        print(
            f"| {groom.name} | {off[0]:.3f} | {off[1]:.3f} | {errors[0]:.4f} | {cells} "
            f"| {other_bits:.1e} |",
            flush=True,
        )
    print(
        f"\nMemory of 16 adaptive to 64 uniform: {memory[layers] / memory[even]:.3f}."
    )


def shadow_speed(context: Any) -> None:
    """Print what shadows cost, beside table 6-1."""
    print("\n## Shadows, 320 000 segments, 64 slices of 512 x 512\n")
    groom = Groom("dense", make_groom(10_000), WIDTH)
    maps = Maps(context, groom, ShadowStyle())
    slices = uniform_slices(float(maps.depth.min()), float(maps.depth.max()), 64)
    ours = median_ms(maps.run)
    print("| way | ms | times ours |\n| --- | --- | --- |")
    print(f"| one pass, compute, with look-ups | {ours:.0f} | 1 |", flush=True)
    ways: dict[str, Way] = {
        "table 6-1, antialiased lines": "smooth",
        "table 6-1, lines clipped by fragments": "fragment",
        "table 6-1, lines clipped by planes": "planes",
    }
    for title, way in ways.items():
        table = Table61(context, groom.strands, WIDTH, maps.view, way)
        cost = median_ms(
            lambda table=table: table.draw(slices), 5 if way != "smooth" else 2
        )
        print(f"| {title} | {cost:.0f} | {cost / ours:.1f} |", flush=True)
    lines = LineMaps(context, groom.strands, WIDTH)
    for title, way in (
        ("OpenGL 3.3, slab after slab", lines.by_passes),
        ("OpenGL 3.3, 32 slabs a draw", lines.by_targets),
    ):
        cost = median_ms(lambda way=way: way(maps.view, slices), 3)
        print(f"| {title} | {cost:.0f} | {cost / ours:.1f} |", flush=True)
    for style in (ShadowStyle(scheme="adaptive", slices=16), PREVIEW_SHADOWS):
        other = Maps(context, groom, style)
        cost = median_ms(other.run)
        title = f"one pass, {style.slices} {style.scheme}, {style.size} x {style.size}"
        print(f"| {title} | {cost:.0f} | {cost / ours:.1f} |")
        other.release()
    runs = set()
    for _ in range(10):
        maps.run()
        runs.add(hashlib.sha256(maps.out.read()).hexdigest())
    print(f"\nTen runs: {len(runs)} different result(s).")
    maps.release()
    thesis = Groom("thesis", make_groom(10_000, 41), WIDTH)
    case = Maps(context, thesis, ShadowStyle(size=200, slices=40))
    cost = median_ms(case.run)
    print(f"10 000 x 40 segments, 40 maps of 200 x 200: {cost:.0f} ms (5 880 in 2002).")
    case.release()


def frame_speed(context: Any) -> None:
    """Print what frames cost, with shadows computed for each."""
    print("\n## Frames: shadows of one light, shading, antialiased, on a head\n")
    print("| segments | picture | maps | all | shadows | the rest |")
    print("| --- | --- | --- | --- | --- | --- |")
    light = DistantLight(jnp.asarray(TO_LIGHT / np.linalg.norm(TO_LIGHT)), jnp.ones(3))
    cases = [
        (2_000, (640, 360), PREVIEW_SHADOWS),
        (10_000, (1280, 720), ShadowStyle()),
        (10_000, (1280, 720), ShadowStyle(scheme="adaptive", slices=16)),
    ]
    if "llvmpipe" not in context.info["GL_RENDERER"]:
        cases.append((50_000, (1280, 720), ShadowStyle(scheme="adaptive", slices=16)))
    for count, size, shadows in cases:
        strands = make_groom(count)
        scene = Scene(
            strands,
            look=HairLook(width=WIDTH),
            head=make_subject().head,
            lights=(light,),
            shadows=shadows,
        )
        frames = Frames(context, scene, FrameStyle(samples=1))
        camera = orbit_camera(strands, 0.4, 0.1, size)

        def frame(frames=frames, camera=camera):
            frames.relight()
            frames.draw(camera)

        def relit(frames=frames):
            frames.relight()
            context.finish()

        whole, lit = median_ms(frame), median_ms(relit)
        rest = median_ms(lambda frames=frames, camera=camera: frames.draw(camera))
        maps = f"{shadows.slices} {shadows.scheme}, {shadows.size}²"
        print(
            f"| {count * 32} | {size[0]} x {size[1]} | {maps} | {whole:.0f} ms | "
            f"{lit:.0f} | {rest:.0f} |",
            flush=True,
        )
        frames.release()


def antialiasing(context: Any) -> None:
    """Print how close pictures are to one with 16 x 16 samples a pixel."""
    print("\n## Antialiasing, 160 x 120, PSNR in dB against 16 x 16 samples a pixel\n")
    names = (
        "plain lines",
        "bins, blended",
        "k-buffer 8",
        "k-buffer 32",
        "2 x 2 k-buffers",
    )
    print(f"| hair | {' | '.join(names)} | 16 pictures accumulated | 512 bins, exact |")
    print("| --- " * 8 + "|")
    K = jnp.array([[288.0, 0.0, 80.0], [0.0, 288.0, 70.0], [0.0, 0.0, 1.0]])
    pose = jnp.diag(jnp.array([1.0, -1.0, -1.0, 1.0])).at[2, 3].set(0.8)
    camera = Camera(K, pose, 160, 120)
    for count, width in ((4_000, 3e-4), (10_000, 3e-4), (2_500, 8e-4)):
        strands = make_groom(count)
        rng = np.random.default_rng(0)
        bright = np.exp(0.3 * rng.standard_normal((count, 1, 1)))
        colours = np.broadcast_to(2.0 * bright * HairLook().colour, strands.shape)
        scene = Scene(
            strands,
            look=HairLook(width=width),
            background=Background((0.8, 0.8, 0.8)),
        )
        lines = HairLines(context, scene, colours)
        truth = lines.supersampled(camera, 16)
        blended = lines.blended(camera)
        found = [lines.plain(camera), blended]
        for style in (FrameStyle(), FrameStyle(deep=32), FrameStyle(fine=2)):
            frames = Frames(context, scene, style)
            found.append(frames.draw_linear(camera, colours))
            frames.release()
        found.append(lines.accumulated(camera, 16))
        lines.release()
        view = camera_view(camera)
        pieces = hair_pieces(strands, width, view)
        strand = pieces.segment // (strands.shape[1] - 1)
        exact = composite(pieces, colours[strand, 0], 1.0, view)
        seen = exact.colour + (1.0 - exact.coverage[..., None]) * 0.8
        values = [psnr(one, truth) for one in found] + [psnr(blended, seen)]
        px = width * float(see_all(strands, view)[..., 3].mean())
        cells = " | ".join(f"{x:.1f}" for x in values)
        print(f"| {count} of {px:.2f} px | {cells} |", flush=True)


def agreement(context: Any) -> None:
    """Print the times of `observe`, and how far it is from the frames of OpenGL."""
    print("\n## Observed by JAX, 64 000 segments, 256 x 256\n")
    measure_observe()
    print("\n| beside OpenGL | mask IoU | orientation, mean of the mask |")
    print("| --- | --- | --- |")
    for count, width, blur, samples in (
        (10_000, 1e-4, 1.0, None),
        (10_000, 1e-4, 0.5, 8),
        (2_000, 3e-4, 1.0, None),
        (2_000, 3e-4, 0.2, 24),
    ):
        config = ObserveConfig(samples=samples, blur=blur)
        iou, degrees = compare(context, make_groom(count), width, config)
        title = f"{count} strands of {1e3 * width:.1f} mm, blur {blur}"
        print(
            f"| {title}, {samples or 'default'} samples | {iou:.3f} | {degrees:.2f}° |"
        )


def compare(
    context: Any, strands: np.ndarray, width: float, config: ObserveConfig
) -> tuple[float, float]:
    """Return the overlap of masks, and degrees between orientations within both."""
    view = make_view()
    points = jnp.asarray(strands, jnp.float32)
    turn = np.gradient(see_all(strands, view)[..., :2], axis=1)
    angle = np.arctan2(turn[..., 1], turn[..., 0])
    doubled = np.stack([np.cos(2 * angle), np.sin(2 * angle), 0.0 * angle], -1)
    look = HairLook(width=width)
    scene = Scene(strands, look=look, background=Background(colour=None))
    frames = Frames(context, scene, FrameStyle(deep=32))
    drawn = frames.draw_linear(make_camera(), 0.5 + 0.5 * doubled)
    frames.release()
    look = Appearance(jnp.asarray(width, jnp.float32), jnp.zeros_like(points))
    seen = observe(points, view, look, config=config)
    cover, other = drawn[..., 3], np.asarray(seen.coverage)
    either, both = (cover > 0.5) | (other > 0.5), (cover > 0.5) & (other > 0.5)
    angles = [
        0.5 * np.arctan2(x[..., 1], x[..., 0])[both]
        for x in (2.0 * drawn[..., :2] - cover[..., None], np.asarray(seen.orientation))
    ]
    apart = np.abs((angles[0] - angles[1] + np.pi / 2) % np.pi - np.pi / 2)
    return float(both.sum() / either.sum()), float(np.degrees(apart.mean()))


PARTS = {
    "accuracy": accuracy,
    "shadows": shadow_speed,
    "frames": frame_speed,
    "antialiasing": antialiasing,
    "observe": agreement,
}


def main() -> None:
    """Print what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", choices=[*PARTS, []], default=[])
    chosen = parser.parse_args().parts or list(PARTS)
    context = open_context()
    print(f"{machine()}; OpenGL: {context.info['GL_RENDERER']}")
    for name in chosen:
        PARTS[name](context)


if __name__ == "__main__":
    main()
