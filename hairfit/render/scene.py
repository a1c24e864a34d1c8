"""What is in a picture: hair, what it looks like, a head, lights and what is behind."""

import dataclasses

import numpy as np
from jaxtyping import Float

from ..types import Mesh
from .lights import DistantLight, PointLight
from .phase_table import PhaseTable
from .raster import vertex_normals
from .shadow_style import ShadowStyle
from .view import View, distant_view, lamp_view

Light = DistantLight | PointLight
Colour = tuple[float, float, float]
MOST_LIGHTS = 16
# Vertices of a head look for light so far outside of it, in metres.
OUTSIDE = 0.002


@dataclasses.dataclass(frozen=True)
class HairLook:
    r"""What hair looks like. Linear RGB, metres.

    Attributes:
        colour: Its own colour.
        width: Width of a hair.
        alpha: Opacity of what a hair covers (figure 6-16).
        ambient: Share of its colour that it sends back of the sky, $K_a$.
        diffuse: Share that it scatters evenly, $K_d$.
        specular: Strength of the highlight, $K_s$.
        coloured: Share of the hair's own colour in the highlight.
        shininess: Exponent of the highlight, $p$.
        forward: Share of the light that goes on through a hair, which its shadow lacks.
        variation: Share by which hairs differ in brightness.
        table: Scattering function that takes the place of the highlight.
    """

    colour: Colour = (0.24, 0.110, 0.048)
    width: float = 0.00008
    alpha: float = 1.0
    ambient: float = 0.35
    diffuse: float = 0.65
    specular: Colour = (0.35, 0.35, 0.35)
    coloured: float = 0.6
    shininess: float = 24.0
    forward: Colour = (0.0, 0.0, 0.0)
    variation: float = 0.3
    table: PhaseTable | None = None


@dataclasses.dataclass(frozen=True)
class Background:
    """What is seen where there is neither hair nor head. Linear RGB.

    Attributes:
        colour: An even colour, or None for a transparent picture.
        picture: A picture of the camera's size instead, as a photograph or a scene
            that another program has rendered.
        depth: Depth of the picture along the optical axis in metres, infinite where
            nothing hides hair; None if all of it is behind.
    """

    colour: Colour | None = (0.82, 0.83, 0.85)
    picture: Float[np.ndarray, "height width 3"] | None = None
    depth: Float[np.ndarray, "height width"] | None = None


@dataclasses.dataclass(frozen=True)
class Scene:
    """Hair on a head in light.

    Attributes:
        strands: Strands of equal counts of points, in metres, root first.
        look: What the hair looks like.
        tint: Colour of each strand, which takes the place of the look's.
        head: What wears it, or None.
        skin: Colour of the head.
        lights: At most sixteen; a light's colour is what a white matt surface that
            faces it sends to the eye.
        sky: Light from all sides.
        shadows: How shadows are made; None for none.
        cover: A surface that all hair lies within, as the tubes of a tree's clusters:
            adaptive shadows then need not look for the first and last hair.
        background: What is behind.

    Raises:
        ValueError: If there are more lights than that.
    """

    strands: Float[np.ndarray, "strands knots 3"]
    look: HairLook = HairLook()
    tint: Float[np.ndarray, "strands 3"] | None = None
    head: Mesh | None = None
    skin: Colour = (0.42, 0.40, 0.38)
    lights: tuple[Light, ...] = ()
    sky: Colour = (0.3, 0.3, 0.3)
    shadows: ShadowStyle | None = ShadowStyle()
    cover: Mesh | None = None
    background: Background = Background()

    def __post_init__(self):
        if len(self.lights) > MOST_LIGHTS:
            raise ValueError(
                f"a scene has at most {MOST_LIGHTS} lights, got {len(self.lights)}; "
                "add the weakest to `sky`."
            )

    @property
    def kappa(self) -> Float[np.ndarray, " 3"]:
        r"""How much of each colour the opacity of hair takes, $\kappa$ of table 6-1."""
        kappa = 1.0 if self.shadows is None else self.shadows.kappa
        return kappa * self.look.alpha * (1.0 - np.asarray(self.look.forward))

    @property
    def tints(self) -> Float[np.ndarray, "strands 4"]:
        """The colour of each strand, and how bright it is beside the others."""
        count = len(self.strands)
        own = np.asarray(self.look.colour) if self.tint is None else self.tint
        rng = np.random.default_rng(0)
        bright = np.exp(self.look.variation * rng.standard_normal((count, 1)))
        return np.concatenate([bright * own, bright], 1)


def head_places(head: Mesh) -> Float[np.ndarray, "vertices 3"]:
    """Return where a head looks for light: a little outside, in metres."""
    return np.asarray(head.vertices, np.float64) + OUTSIDE * vertex_normals(head)


def light_view(light: Light, points: Float[np.ndarray, "points 3"], size: int) -> View:
    """Return the view of a light that holds all points."""
    if isinstance(light, PointLight):
        return lamp_view(np.asarray(light.position, np.float64), points, size)
    return distant_view(np.asarray(light.to_light, np.float64), points, size)
