"""The way from a capture to a hair tree, stage by stage."""

import dataclasses
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from ..capture.capture import Capture, View
from ..capture.orientation import OrientationMap
from ..errors import InputError
from ..evaluate.shape import strand_lengths
from ..evaluate.visibility import Sight, even_strands
from ..host import on_device, one_blas_thread
from ..io.tree import load_tree, round_tree, save_tree
from ..model.maps import ScalpMaps, even_maps, fill
from ..model.scalp import Scalp, normals_on, points_on, sample_roots
from ..model.strand import sample_hair
from ..model.tree import HairTree, children, leaves, levels
from ..types import Mesh, Strands, along_paths, resample_paths
from .ahead import (
    Shapes,
    compile_growth,
    compile_looks,
    compile_paths,
    compile_refinement,
    compile_strands,
    compiling_ahead,
    spare_threads,
)
from .appearance import LIT, Appearance, find_appearance, some_of
from .branches import with_branches
from .bridges import bridged
from .checkpoint import Checkpoint
from .confidence import ConfidenceConfig, with_confidence
from .consistency import carve_by_consistency
from .corners import carve_corners
from .cost import Quality, affordable, refine_until
from .curls import Curls, points_for, see_curls
from .density import TEXELS
from .derive import Derived, derive_hair, with_spare
from .evidence import Field
from .flow import hair_field, hair_flow
from .gather import Rooted, gather_strands
from .grow import grow, space_of, steps_on
from .hull import Hull, carve_sparse
from .locks import with_locks
from .presets import PRESETS, Preset, by_photographs, for_waves
from .prune import prune
from .refine import Photographs, refine
from .residuals import photo_maps
from .samples import samples_of
from .settle import settled
from .shots import (
    Depths,
    Shots,
    coarser_sights,
    largest,
    look_at,
    resampled,
    trusted_shots,
    wrapped_scalp,
)
from .strays import without_strays
from .suspects import Doubt
from .thinning import thinned
from .tips import with_tips_inside
from .treeify import (
    STRANDS_A_LEAF,
    TreeifyConfig,
    fit_levels,
    level_sizes,
    levels_above,
    on_scalp,
)
from .unfaced import with_unfaced
from .volume import hair_volume, inner_places
from .waves import with_lost_waves, with_waves

Progress = Callable[[str, float], None]

# Strands shorter than this did not grow: their roots are bare. Metres.
SHORTEST = 0.004
FEWEST_GROWN = 50


@dataclasses.dataclass(frozen=True)
class FitConfig:
    """How a fit is done."""

    quality: Quality = "normal"
    """How fine: edge of a voxel, number of clusters, steps of refinement."""
    seed: int = 0
    """Of all that is random; the same seed gives the same bytes."""
    strands: int = 16000
    """Number of strands in the result; the tree gives as many as one wants."""
    time_limit: float | None = None
    """Seconds in which to be done, or as soon after as can be: by a coarser quality,
    then by fewer rounds of refinement. What comes out then depends on the machine."""


STRAND_POINTS = 40
GROWN_POINTS = 40  # of a strand as it grows, before it gets the knots of a skeleton


class FitResult(NamedTuple):
    """What a fit found.

    Attributes:
        tree: The hairstyle.
        strands: Strands of the tree, outside the head.
        owner: The leaf cluster of each strand.
        looks: Colour of the hair and light on it, None where it is not seen.
        figures: What `report.json` says of the fit.
        maps: The orientation map of every photograph.
        views: The photographs as they were used: mended, where they had to be.
        depths: Depth of the head in them, in metres.
        doubts: What was wrong with photographs.
    """

    tree: HairTree
    strands: Strands
    owner: Int[np.ndarray, " strands"]
    looks: Appearance | None
    figures: dict[str, Any]
    maps: list[OrientationMap]
    views: tuple[View, ...]
    depths: Depths
    doubts: tuple[Doubt, ...]


@one_blas_thread()
def fit_capture(
    capture: Capture,
    config: FitConfig | None = None,
    *,
    checkpoint: Path | None = None,
    progress: Progress = lambda stage, share: None,
) -> FitResult:
    """Return the hair tree that explains the photographs.

    Args:
        capture: Photographs with cameras and masks, and the head.
        config: How to fit.
        checkpoint: A folder for stages that are done; a later call takes them up.
        progress: Called with what is being done and the share that is done.

    Raises:
        InputError: If there is no head, or the photographs leave no room for hair.
    """
    start = time.monotonic()
    config = config or FitConfig()
    quality = affordable(capture.views, config.quality, config.time_limit)
    config = dataclasses.replace(config, quality=quality)
    preset, stop = PRESETS[quality], refine_until(quality, config.time_limit)
    head = capture.head
    if head is None:
        raise InputError(
            f"no `head.obj` in '{capture.folder}'; put the head's mesh there, in "
            "metres and where the cameras see it."
        )
    store = Checkpoint(checkpoint)
    # Arrays for so many clusters, or each tree would be compiled anew.
    room = sum(level_sizes(preset.leaves, preset.levels))
    first = _first_tree(capture, head, config, room, store, progress)
    views, depths = zip(*first.sights, strict=True)
    hull, tree, maps = first.hull, first.tree, first.maps
    progress("refining the tree", 0.49)
    alike = {"points": preset.refine.points, "room": room}

    def over() -> bool:
        return stop is not None and time.monotonic() - start > stop

    drawn = partial(samples_of, count=preset.refine.strands, seed=config.seed)
    tree = prune(tree, drawn(tree), hull, **alike)
    refined = partial(
        refine,
        samples=drawn(tree),
        photographs=Photographs(views, depths, photo_maps(views, maps, depths)),
        volume=hair_volume(hull, first.field),
        places=inner_places(hull),
        room=room,
        enough=over,
    )
    tree = refined(
        tree,
        config=preset.refine,
        progress=lambda share: progress("refining the tree", 0.49 + 0.33 * share),
    )
    wave = first.curls.wave, first.curls.height
    # Waves that photographs have not corrected are worse than none.
    if first.curls.height > 0.0 and not over():
        tree = with_waves(tree, hull, first.field, *wave, room=room)
        tree = refined(
            tree,
            config=by_photographs(preset.refine),
            progress=lambda share: progress("waving the hair", 0.82 + 0.04 * share),
        )
        tree = with_lost_waves(tree, *wave, room=room)
    tree = prune(tree, drawn(tree), hull, **alike)
    progress("finding what is certain", 0.86)
    with ThreadPoolExecutor(1) as beside:
        certain = beside.submit(
            with_confidence,
            tree,
            drawn(tree),
            views,
            depths,
            maps,
            ConfidenceConfig(points=preset.refine.points),
            room=room,
        )
        # Rounded as its file will hold it, so that the strands are those of the file.
        tree = round_tree(tree)
        progress("drawing strands", 0.87)
        # As many strands as will be drawn, whose program is there already.
        key, spared = jax.random.key(config.seed), with_spare(config.strands)
        points = points_for(tree, first.curls.pitch, STRAND_POINTS)
        # Turns of curls may stand out of the hull: their middle lines end in it.
        skin = single(even_maps(TEXELS, TEXELS))
        tree = dataclasses.replace(tree, maps=skin)
        skin = with_tips_inside(skin, sample_hair(tree, spared, points, key), hull)
        skin = dataclasses.replace(skin, curl=fill(skin.curl, first.curls.radius))
        tree = dataclasses.replace(tree, maps=skin)
        seen = first.curls, first.shots, first.all_maps
        tree = with_locks(tree, *seen, points, config.seed)
        skin = thinned(skin, sample_hair(tree, spared, points, key), first.sights)
        tree = dataclasses.replace(tree, maps=skin)
        hair = sample_hair(tree, spared, points, key)
        skin = without_strays(skin, hair, first.sights, first.curls.radius)
        tree = round_tree(dataclasses.replace(tree, maps=skin))
        hair = derive_hair(tree, head, config.strands, points, config.seed)
    progress("finding colour and light", 0.95)
    looks = _looks(hair, first, head, config.seed)
    if looks is not None:
        colour = fill(skin.colour, jnp.asarray(looks.colour, jnp.float32))
        skin = dataclasses.replace(skin, colour=colour)
    sure = certain.result().confidence
    tree = round_tree(dataclasses.replace(tree, maps=skin, confidence=sure))
    figures = {
        "quality": quality,
        "voxels": int(hull.hair.sum()),
        "voxel_mm": 1e3 * hull.grid.spacing,
        "grown_strands": first.grown,
        "branches": first.branches,
        "levels": len(levels(tree)),
        "root_clusters": len(children(tree, -1)),
        "leaf_clusters": len(leaves(tree)),
        "cylinder_error_mm": 1e3 * first.error,
        "direction_seen": first.curls.told,
        "curl_radius_mm": 1e3 * first.curls.radius,
        "curl_pitch_mm": 1e3 * first.curls.pitch,
        "wave_length_mm": 1e3 * first.curls.wave,
        "wave_height_mm": 1e3 * first.curls.height,
        "median_length_mm": 1e3 * float(np.median(strand_lengths(hair.strands))),
    }
    return FitResult(
        tree,
        *hair,
        looks,
        figures,
        first.all_maps,
        first.shots.trusted.views,
        first.shots.trusted.depths,
        first.shots.doubts,
    )


class First(NamedTuple):
    """A tree before its refinement, and what it was grown from.

    Attributes:
        shots: The photographs.
        sights: Those that are used, no finer than strands are compared with.
        maps: Orientation maps of these, of locks where hair curls.
        curls: How curly the hair is.
        all_maps: Orientation maps of all of them.
        hull: Where hair can be.
        field: Which way it runs there.
        tree: The tree of the grown strands.
        error: How far it is from them, in metres.
        grown: How many they were.
        branches: How many more there were for what they left empty.
    """

    shots: Shots
    sights: list[Sight]
    maps: list[OrientationMap]
    curls: Curls
    all_maps: list[OrientationMap]
    hull: Hull
    field: Field
    tree: HairTree
    error: float
    grown: int
    branches: int


def _first_tree(
    capture: Capture,
    head: Mesh,
    config: FitConfig,
    room: int,
    store: Checkpoint,
    progress: Progress,
) -> First:
    """Return the tree of strands that grow along what the photographs show.

    What the refinement needs is compiled meanwhile, for trees of so many clusters.
    """
    preset = PRESETS[config.quality]
    with compiling_ahead(spare_threads()) as ahead:
        spared = with_spare(config.strands)
        ahead(compile_growth, preset.guides, (preset.refine.strands, spared))
        progress("measuring the head", 0.0)
        shots = trusted_shots(capture.views, head, store)
        views, depths = shots.views, shots.depths
        progress("carving the hull", 0.03)
        hull, gaps = carve_sparse(views, depths, head, preset.spacing)
        hull = with_unfaced(hull, views, depths, head)
        sights = coarser_sights(shots, hull)
        size = largest([sight.view for sight in sights])
        shapes = Shapes(len(views), size, hull.grid.shape, room, preset.knots)

        def compile_for(knots):
            ahead(compile_strands, room, knots, spared, STRAND_POINTS)
            ahead(compile_refinement, shapes._replace(knots=knots), preset.refine)

        ahead(compile_paths, hull.grid.shape, steps_on(preset.spacing))
        compile_for(preset.knots)
        ahead(compile_looks, config.strands, STRAND_POINTS, len(views), head)
        hull = carve_corners(hull, views, depths)
        shots, all_maps = look_at(
            shots,
            store,
            lambda share: progress("finding orientation", 0.11 + 0.02 * share),
        )
        maps = [all_maps[k] for k in shots.used]
        progress("carving by direction", 0.13)
        allowed, curls = hull, see_curls(hull, views, maps)
        if curls.wave > 0.0:
            preset = for_waves(preset)
            compile_for(preset.knots)
        if curls.height > 0.0:
            wavy = shapes._replace(knots=preset.knots)
            ahead(compile_refinement, wavy, by_photographs(preset.refine))
        hull = carve_by_consistency(hull, views, maps, depths, curls.radius > 0.0)
        scalp = capture.scalp or wrapped_scalp(shots, head, gaps)
        progress("growing strands", 0.27)
        roots = _roots(scalp, preset, config)
        hull = bridged(hull if curls.told else allowed, roots.points, views)
        field = _field(hull, shots, curls, roots, store)
        uv, grown = _grow(hull, field, curls, roots, preset, config, store)
        progress("fitting cylinders", 0.46)
        tree, error = _tree(scalp, uv, grown, preset, config, store)
    single_roots = len(np.unique(uv, axis=0))
    return First(
        shots,
        sights,
        resampled(curls.maps, sights),
        curls,
        all_maps,
        hull,
        field,
        tree,
        error,
        single_roots,
        len(uv) - single_roots,
    )


class Grown(NamedTuple):
    """Strands from the evidence: their roots in scalp space, and their points."""

    uv: Float[np.ndarray, "strands 2"]
    strands: Float[np.ndarray, "strands knots 3"]


class Roots(NamedTuple):
    """Where strands grow: in scalp space, in the world, and out of the skin."""

    uv: Float[np.ndarray, "roots 2"]
    points: Float[np.ndarray, "roots 3"]
    normals: Float[np.ndarray, "roots 3"]


def _roots(scalp: Scalp, preset: Preset, config: FitConfig) -> Roots:
    uv = sample_roots(scalp, preset.guides, jax.random.key(config.seed))
    found = uv, points_on(scalp, uv), normals_on(scalp, uv)
    return Roots(*(np.asarray(one, np.float64) for one in found))


def _field(
    hull: Hull,
    shots: Shots,
    curls: Curls,
    roots: Roots,
    store: Checkpoint,
) -> Field:
    saved = store.load("field")
    if saved is None:
        scalp = roots.points, roots.normals
        found = hair_field(hull, shots.views, shots.depths, curls, *scalp)
        saved = {name: one for name, one in found._asdict().items() if one is not None}
        store.save("field", saved)
    return Field(**saved)


def _grow(
    hull: Hull,
    field: Field,
    curls: Curls,
    roots: Roots,
    preset: Preset,
    config: FitConfig,
    store: Checkpoint,
) -> Grown:
    saved = store.load("grown")
    if saved is None:
        uv, start, normals = roots
        step = steps_on(preset.spacing, curly=curls.radius > 0.0)
        flow = hair_flow(hull, field, start, curly=curls.radius > 0.0)
        space = space_of(hull, field, flow)
        strands = grow(space, start, normals, GROWN_POINTS, step)
        some = along_paths(strands)[:, -1] > SHORTEST
        if some.sum() < FEWEST_GROWN:
            raise InputError(
                f"only {some.sum()} of {preset.guides} strands grew from the scalp; "
                "check that `head.obj` stands where the cameras see the head, and that "
                "`masks/hair` hold the hair on it."
            )
        uv, strands = uv[some], strands[some]
        strands, origin = with_branches(hull, space, strands, step, config.seed)
        saved = {"uv": uv[origin], "strands": resample_paths(strands, preset.knots)}
        store.save("grown", saved)
    return Grown(**saved)


def _tree(
    scalp: Scalp,
    uv: Float[np.ndarray, "strands 2"],
    strands: Float[np.ndarray, "strands knots 3"],
    preset: Preset,
    config: FitConfig,
    store: Checkpoint,
) -> tuple[HairTree, float]:
    """Return the tree of the grown strands, and its distance from them in metres."""
    saved = store.load("cylinders")
    if saved is not None:
        return load_tree(store.path("tree.hairtree")), float(saved["error"])
    rooted = Rooted(uv, strands, on_scalp(scalp, uv).slope)
    how = TreeifyConfig(preset.leaves, preset.levels, preset.knots, seed=config.seed)
    count = min(preset.leaves, len(uv) // STRANDS_A_LEAF)
    label = gather_strands(rooted, count, rounds=how.rounds, seed=how.seed)
    if preset.settles:
        rooted, label = settled(scalp, rooted, label, preset.guides, config.seed)
    found = levels_above(rooted, label, how)
    fitted = fit_levels(scalp, rooted, found, how.steps)
    tree = single(fitted.tree)
    if store.folder is not None:
        save_tree(store.path("tree.hairtree"), tree, exact=True)
        store.save("cylinders", {"error": np.array(fitted.error)})
    return tree, fitted.error


def _looks(hair: Derived, first: First, head: Mesh, seed: int) -> Appearance | None:
    """Return looks of hair and the light on it, with the exposure of every photograph.

    Photographs that are not used are taken to be exposed as the others.
    """
    points = even_strands(hair.strands).astype(np.float64)
    found = find_appearance(some_of(points, LIT), first.sights, head, seed)
    if found is None:
        return None
    exposure = np.ones(len(first.shots.trusted.views))
    exposure[first.shots.used] = found.exposure
    return found._replace(exposure=exposure)


Module = TypeVar("Module", HairTree, ScalpMaps)


def single(module: Module) -> Module:
    """Return a module in single precision, as trees of fits are."""
    return jax.tree.map(lambda leaf: on_device(leaf, jnp.float32), module)
