"""What the examples share: a head to model on, pictures of hair, and sheets of them."""

import pathlib
import textwrap
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, UInt8
from matplotlib.figure import Figure

from hairfit.model import HairTree, cluster, cylinder_knots
from hairfit.render.camera import Camera
from hairfit.render.raster import project_points
from hairfit.report.drawing import draw_hair, orbit_camera
from hairfit.synthetic.gallery import make_subject

PICTURES = pathlib.Path(__file__).parent.parent / "docs" / "pictures"
SIZE = (420, 520)


def look_from(
    azimuth_deg: float = 30.0,
    elevation_deg: float = 8.0,
    size: tuple[int, int] = SIZE,
    low: Sequence[float] = (-0.13, -0.22, -0.16),
    high: Sequence[float] = (0.13, 0.15, 0.14),
) -> Camera:
    """Return a camera that has the box from `low` to `high` in its picture."""
    box = np.array([[low, high]], float)
    angles = float(np.radians(azimuth_deg)), float(np.radians(elevation_deg))
    return orbit_camera(box, *angles, size)


def photograph(
    strands: Float[np.ndarray, "strands points 3"], camera: Camera
) -> UInt8[np.ndarray, "height width 3"]:
    """Return a picture of hair on the head."""
    return draw_hair(np.asarray(strands, np.float64), make_subject().head, [camera])[0]


def draw_curves(
    axes,
    curves: Float[np.ndarray, "curves points 3"],
    camera: Camera,
    **style,
) -> None:
    """Draw curves over a picture by the same camera: skeletons, or contours.

    Args:
        axes: Of matplotlib.
        curves: Points in the world, in metres.
        camera: The camera of the picture.
        style: What `matplotlib.axes.Axes.plot` takes.
    """
    count, points, _ = curves.shape
    pixels = project_points(np.asarray(curves, float).reshape(-1, 3), camera)[0]
    for one in np.asarray(pixels).reshape(count, points, 2):
        axes.plot(one[:, 0], one[:, 1], **style)


def cross_sections(
    tree: HairTree, index: int, turns: int = 33
) -> Float[np.ndarray, "knots turns 3"]:
    """Return the contours of one cluster in the world, closed, one a knot."""
    theta = jnp.linspace(0.0, 2.0 * jnp.pi, turns)
    return np.asarray(around(cluster(tree.cylinder, index), 1.0, theta))


around = jax.jit(jax.vmap(cylinder_knots, (None, None, 0), 1))


class Sheet:
    """Pictures and drawings side by side, each with a title."""

    def __init__(self, rows: int, columns: int, size: tuple[int, int] = SIZE):
        self.figure = Figure(
            figsize=(columns * size[0] / 130, rows * (size[1] / 130 + 0.35)), dpi=130
        )
        self.axes = self.figure.subplots(rows, columns, squeeze=False).ravel()
        self.next = 0
        self.letters = size[0] // 10  # of a line of the title

    def add(self, title: str, picture: UInt8[np.ndarray, "height width 3"] | None):
        """Add a picture, or an empty drawing, and return its axes."""
        axes = self.axes[self.next]
        self.next += 1
        axes.set_title("\n".join(textwrap.wrap(title, self.letters)), fontsize=8)
        if picture is not None:
            axes.imshow(picture)
            axes.set_xlim(-0.5, picture.shape[1] - 0.5)
            axes.set_ylim(picture.shape[0] - 0.5, -0.5)
            axes.set_axis_off()
        return axes

    def save(self, path: pathlib.Path) -> None:
        """Write the sheet as a JPEG."""
        for axes in self.axes[self.next :]:
            axes.set_axis_off()
        self.figure.tight_layout(pad=0.4)
        path.parent.mkdir(parents=True, exist_ok=True)
        self.figure.savefig(path, pil_kwargs={"quality": 85})
        print(f"wrote {path}")
