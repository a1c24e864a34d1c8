"""Light on a scene's hair and head, by JAX: what `render.gl` does with shaders."""

from collections.abc import Iterator
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.ndimage import map_coordinates
from jaxtyping import Array, Bool, Float

from ..host import on_device
from ..types import Mesh
from .lights import Arriving, PointLight, knot_tangents, unit
from .opacity_volume import OpacityConfig, OpacityVolume, opacity_volume
from .phase import PhaseAngles, phase_angles
from .raster import share_to_faces, vertex_normals
from .scene import HairLook, Light, Scene, head_places, light_view
from .shading import Fibre, kajiya_kay
from .strand_samples import samples_needed
from .view import View

# Slabs that do what layers of their own depth in every texel do, and the largest map
# that is not too slow.
SLABS, LARGEST = 64, 512
# Of a segment: so that small maps share a program, however many would do.
FEWEST_SAMPLES = 3


class Arrived(NamedTuple):
    """Light at places, through hair and past the head.

    Attributes:
        to_light: Unit vectors towards each light.
        radiance: What arrives of it, linear RGB.
    """

    to_light: Float[Array, "lights places 3"]
    radiance: Float[Array, "lights places 3"]


def number() -> np.dtype:
    """Return the type of floating point that JAX computes with."""
    return jnp.zeros(()).dtype


def light_at(
    places: Float[np.ndarray, "places 3"],
    scene: Scene,
    lights: tuple[Light, ...],
) -> Arrived:
    """Return the light at places of a scene.

    Args:
        places: Where, in metres.
        scene: Hair and head that cast shadows; its own lights do not count.
        lights: The lights.
    """
    at = on_device(places, number())
    kappa = on_device(scene.kappa, number())
    head = None if scene.head is None else solid(scene.head)
    found = []
    for light, volume in zip(lights, hair_before(lights, scene), strict=True):
        free = np.ones(len(places), bool)
        if scene.shadows is not None and head is not None:
            free = lit_past(head, places, light, scene.shadows.bias)
        found.append(arriving(light, volume, kappa, on_device(free), at))
    if not found:
        return Arrived(*[jnp.zeros((0, len(places), 3), number())] * 2)
    return Arrived(*(jnp.stack(part) for part in zip(*found, strict=True)))


def hair_before(
    lights: tuple[Light, ...], scene: Scene
) -> Iterator[OpacityVolume | None]:
    """Give the opacity of hair before each light, None where none casts shadows."""
    style = scene.shadows
    if style is None or scene.strands.size == 0:
        yield from (None for _ in lights)
        return
    points = np.asarray(scene.strands, number())
    flat, size = points.reshape(-1, 3).astype(np.float64), min(style.size, LARGEST)
    views = [
        jax.tree.map(lambda x: on_device(x, number()), light_view(light, flat, size))
        for light in lights
    ]
    slabs = SLABS if style.scheme == "adaptive" else max(style.slices, 2)
    hair, width = on_device(points), on_device(scene.look.width, number())
    # The same for all lights: one program.
    most = max((samples_needed(hair, view) for view in views), default=1)
    config = OpacityConfig(slabs, rounded_up(max(most, FEWEST_SAMPLES)))
    for view in views:
        yield volume_of(hair, width, view, config)


@partial(jax.jit, static_argnames="config")
def volume_of(
    points: Float[Array, "strands knots 3"],
    width: Float[Array, ""],
    view: View,
    config: OpacityConfig,
) -> OpacityVolume:
    """Return the opacity of hair before a light."""
    return opacity_volume(points, width, view, config=config)


@jax.jit
def arriving(
    light: Light,
    volume: OpacityVolume | None,
    kappa: Float[Array, " 3"],
    free: Bool[Array, " places"],
    places: Float[Array, "places 3"],
) -> Arriving:
    """Return the light at places, through hair where there is a volume of it.

    Args:
        light: The light.
        volume: The opacity of hair before it.
        kappa: What that takes of each colour.
        free: Which places a head does not hide.
        places: Where, in metres.
    """
    found = jax.vmap(light.arriving)(places)
    share = free.astype(places.dtype)[:, None]
    if volume is not None:
        share = share * jnp.exp(-kappa[None] * volume.at(places)[:, None])
    return Arriving(found.to_light, found.radiance * share)


def rounded_up(count: int) -> int:
    """Return a number of samples that is at least `count`, one of few."""
    power = 1 << (count - 1).bit_length()
    return 3 * power // 4 if power >= 4 and count <= 3 * power // 4 else power


class Solid(NamedTuple):
    """A mesh, and what tells which rays meet it."""

    mesh: Mesh
    rays: Any


def solid(mesh: Mesh) -> Solid:
    """Return a mesh prepared for many rays."""
    import trimesh

    return Solid(mesh, trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).ray)


def lit_past(
    head: Solid, places: Float[np.ndarray, "places 3"], light: Light, bias: float
) -> Bool[np.ndarray, " places"]:
    """Return which places a head does not hide from a light.

    Args:
        head: The head.
        places: Where, in metres.
        light: The light.
        bias: How deep under the skin it is still light, in metres.
    """
    if isinstance(light, PointLight):
        way = np.asarray(light.position, np.float64) - places
    else:
        way = np.broadcast_to(np.asarray(light.to_light, np.float64), places.shape)
    distance = np.linalg.norm(way, axis=1)
    towards = way / np.maximum(distance, 1e-12)[:, None]
    start = places + bias * towards
    face = head.rays.intersects_first(start, towards)
    hidden = face >= 0
    if isinstance(light, PointLight):
        hidden &= share_to_faces(head.mesh, face, start, towards) < distance - bias
    return ~hidden


def hair_radiance(
    scene: Scene, arrived: Arrived, eye: Float[np.ndarray, " 3"]
) -> Float[Array, "strands knots 3"]:
    """Return the light that each knot of hair sends to the eye, linear RGB.

    Args:
        scene: The hair and its look.
        arrived: The light at all knots, strand by strand.
        eye: Where the eye is, in metres.
    """
    look, points = scene.look, jnp.asarray(scene.strands, number())
    tangent = knot_tangents(points).reshape(-1, 3)
    tints = np.repeat(scene.tints, points.shape[1], axis=0)
    own, bright = (
        jnp.asarray(tints[:, :3], number()),
        jnp.asarray(tints[:, 3], number()),
    )
    to_eye = jax.vmap(unit)(jnp.asarray(eye[None], number()) - points.reshape(-1, 3))
    total = look.ambient * own * jnp.asarray([scene.sky], number())
    for way, radiance in zip(arrived.to_light, arrived.radiance, strict=True):
        if look.table is None:
            sent = highlit(tangent, way, to_eye, own, plain(look))
        else:
            sent = look.diffuse * own * across(tangent, way)
            values = jnp.asarray(look.table.values, number())
            sent = sent + bright[:, None] * tabled(values, tangent, way, to_eye)
        total = total + sent * radiance
    return total.reshape(points.shape)


class PlainLook(NamedTuple):
    """Kajiya's and Kay's part of a look."""

    diffuse: float
    specular: tuple[float, float, float]
    coloured: float
    shininess: float


def plain(look: HairLook) -> PlainLook:
    """Return Kajiya's and Kay's part of a look."""
    return PlainLook(look.diffuse, look.specular, look.coloured, look.shininess)


@partial(jax.jit, static_argnames="look")
def highlit(
    tangent: Float[Array, "knots 3"],
    to_light: Float[Array, "knots 3"],
    to_eye: Float[Array, "knots 3"],
    own: Float[Array, "knots 3"],
    look: PlainLook,
) -> Float[Array, "knots 3"]:
    """Return what knots of their own colours send of a light of 1."""
    kind = own.dtype
    specular = jnp.asarray(look.specular, kind)

    def one(t, light, eye, colour):
        shine = specular * (1.0 - look.coloured + look.coloured * colour)
        power = jnp.asarray(look.shininess, kind)
        fibre = Fibre(jnp.zeros(3, kind), look.diffuse * colour, shine, power)
        return kajiya_kay(t, light, eye, fibre)

    return jax.vmap(one)(tangent, to_light, to_eye, own)


def across(
    tangent: Float[Array, "knots 3"], way: Float[Array, "knots 3"]
) -> Float[Array, "knots 1"]:
    """Return the sines of the angles between strands and light."""
    along = jnp.sum(tangent * way, axis=1, keepdims=True)
    return jnp.sqrt(jnp.maximum(1.0 - along**2, 0.0))


@jax.jit
def tabled(
    values: Float[Array, "eyes lights azimuths 3"],
    tangent: Float[Array, "knots 3"],
    to_light: Float[Array, "knots 3"],
    to_eye: Float[Array, "knots 3"],
) -> Float[Array, "knots 3"]:
    """Return what a `PhaseTable` says for knots, linear between its entries."""
    angles: PhaseAngles = jax.vmap(phase_angles)(tangent, to_light, to_eye)
    eyes, lights, azimuths, _ = values.shape
    place = [
        (angles.theta_eye / jnp.pi + 0.5) * eyes - 0.5,
        (angles.theta / jnp.pi + 0.5) * lights - 0.5,
        jnp.abs(angles.phi) / jnp.pi * azimuths - 0.5,
    ]
    shine = [
        map_coordinates(values[..., c], place, order=1, mode="nearest")
        for c in range(3)
    ]
    return jnp.stack(shine, -1)


def head_radiance(
    scene: Scene, arrived: Arrived, eye: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, "vertices 3"]:
    """Return the light that each vertex of the head, a matt surface, sends to the eye.

    Args:
        scene: The head and its skin.
        arrived: The light at `head_places`.
        eye: Where the eye is, in metres.
    """
    assert scene.head is not None
    normal = turned_to(eye, vertex_normals(scene.head), head_places(scene.head))
    total = np.asarray(scene.sky) * from_sky(normal)[:, None]
    ways, radiance = (np.asarray(x, np.float64) for x in arrived)
    for way, light in zip(ways, radiance, strict=True):
        facing = np.maximum(np.einsum("ij,ij->i", normal, way), 0.0)
        total = total + facing[:, None] * light
    return np.asarray(scene.skin) * total


def turned_to(
    eye: Float[np.ndarray, " 3"],
    normal: Float[np.ndarray, "places 3"],
    places: Float[np.ndarray, "places 3"],
) -> Float[np.ndarray, "places 3"]:
    """Return normals on the side that an eye sees.

    Meshes of artists have faces that are turned inside out.
    """
    away = np.einsum("ij,ij->i", normal, eye - places) < 0.0
    return np.where(away[:, None], -normal, normal)


def from_sky(normal: Float[np.ndarray, "places 3"]) -> Float[np.ndarray, " places"]:
    """Return what white matt places send back of light from all sides."""
    return 0.75 + 0.25 * normal[:, 1]
