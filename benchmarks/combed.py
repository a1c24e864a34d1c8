"""Hair combed on the head of ICT's face kit by rules that share no code with a fit.

`path_traced.py` photographs these styles. Every hair grows from its root in small
steps: it turns towards where its style wants it, slides along what it would enter, and
is held above the skin by the hair below it. Hairs of a wisp go nearly alike.
"""

import dataclasses
import pathlib
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from hairfit.io.mesh import load_mesh
from hairfit.render.raster import unit
from hairfit.types import Mesh, Strands, along_paths, resample_paths

HEAD = (
    pathlib.Path(__file__).parents[2] / "shared" / "files" / "heads" / "ict_neutral.obj"
)
CENTIMETRE = 0.01
MIDDLE = np.array([0.0, 0.040, 0.005])  # of the cranium
# Where hair begins: azimuth from the face, and elevation about the cranium's middle.
HAIRLINE = np.array(
    [[0, 33], [35, 31], [55, 24], [70, 8], [78, 4], [100, 16], [125, -22], [180, -42]]
)
HIGH_TIE = np.array([0.0, 0.118, -0.085])
STEP = 0.003
KNOTS = 40
SAMPLES = 60_000  # of the head's surface
DOWN, UP, BACK, LEFT = np.array(
    [[0.0, -1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]
)


class Skin(NamedTuple):
    """Points on a head in metres and the normals there, (P, 3) each."""

    points: np.ndarray
    normals: np.ndarray


class Roots(NamedTuple):
    """Where hairs begin.

    Attributes:
        points: In metres, (N, 3).
        normals: Of the skin, (N, 3).
        azimuth: From the face to the left ear, in degrees, (N,).
        elevation: Above the middle of the cranium, in degrees, (N,).
        chance: Three even numbers in 0...1 for each wisp, (N, 3).
    """

    points: np.ndarray
    normals: np.ndarray
    azimuth: np.ndarray
    elevation: np.ndarray
    chance: np.ndarray


@dataclasses.dataclass(frozen=True)
class Plan:
    """How hair is combed.

    Attributes:
        length: In metres, (N,).
        way: Where hair wants to go, from points (N, 3) and lengths up to there (N,).
        above: How far hair comes to lie above the skin, in metres, (N,).
        turn: Along how much of its length hair turns to its way, in metres.
        wild: How far wisps leave their way, as a part of it.
        cut: Hair ends where this is true of its points, None for nowhere.
    """

    length: np.ndarray
    way: Callable[[np.ndarray, np.ndarray], np.ndarray]
    above: np.ndarray
    turn: float = 0.02
    wild: float = 0.15
    cut: Callable[[np.ndarray], np.ndarray] | None = None


class Style(NamedTuple):
    """A style: its plan for roots, how many hairs, and in wisps of how many."""

    plan: Callable[[Roots], Plan]
    hairs: int = 20_000
    wisp: int = 40


def load_head() -> Mesh:
    """Return ICT's head in metres."""
    mesh = load_mesh(HEAD)
    return dataclasses.replace(mesh, vertices=CENTIMETRE * mesh.vertices)


def comb(name: str, seed: int = 0) -> Strands:
    """Return the hair of one of the `STYLES`."""
    style = STYLES[name]
    rng = np.random.default_rng(seed)
    skin = sample_skin(load_head(), rng)
    roots, wisp, leader = make_roots(skin, style, rng)
    plan = style.plan(roots)
    paths, ends = grow(skin, roots, plan, wisp, rng)
    # Hairs of a wisp come together towards its tip.
    near = along_paths(paths) / np.maximum(plan.length, STEP)[:, None]
    alike = plan.length[leader] < 2.0 * plan.length
    pull = 0.6 * alike[:, None] * np.clip(near, 0.0, 1.0) ** 1.5
    paths += pull[..., None] * (paths[leader] - paths)
    # Beyond its end a hair stays where it is.
    step = np.minimum(np.arange(paths.shape[1]), ends[:, None])
    cut = np.take_along_axis(paths, step[..., None], axis=1)
    return Strands.from_array(resample_paths(cut, KNOTS))


def sample_skin(head: Mesh, rng: np.random.Generator) -> Skin:
    """Return points spread evenly over a head."""
    corners = np.asarray(head.vertices, np.float64)[head.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(across, axis=1)
    face = rng.choice(len(area), SAMPLES, p=area / area.sum())
    share = rng.dirichlet([1.0, 1.0, 1.0], SAMPLES)
    points = np.einsum("pc,pcd->pd", share, corners[face])
    return Skin(points, unit(across[face]))


def make_roots(
    skin: Skin, style: Style, rng: np.random.Generator
) -> tuple[Roots, np.ndarray, np.ndarray]:
    """Return roots within the hairline, their wisps, and the leaders of these."""
    off = skin.points - MIDDLE
    azimuth = np.degrees(np.arctan2(off[:, 0], off[:, 2]))
    elevation = np.degrees(np.arctan2(off[:, 1], np.hypot(off[:, 0], off[:, 2])))
    far = np.linalg.norm(off, axis=1)
    ears = (np.abs(off[:, 0]) > 0.080) & (elevation < 20.0)
    above = elevation > np.interp(np.abs(azimuth), *HAIRLINE.T) + rng.normal(
        0.0, 1.5, len(far)
    )
    inside = np.flatnonzero(above & ~ears & (far < 0.125))
    chosen = inside[
        rng.choice(len(inside), style.hairs, replace=len(inside) < style.hairs)
    ]
    points = skin.points[chosen]
    middles = rng.choice(style.hairs, style.hairs // style.wisp, replace=False)
    wisp = np.asarray(KDTree(points[middles]).query(points)[1])
    chance = rng.random((len(middles), 3))[wisp]
    roots = Roots(
        points, skin.normals[chosen], azimuth[chosen], elevation[chosen], chance
    )
    return roots, wisp, middles[wisp]


def grow(
    skin: Skin, roots: Roots, plan: Plan, wisp: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Return the paths of hairs, (N, steps, 3), and after how many steps each ends."""
    tree = KDTree(skin.points)
    count = int(np.ceil(plan.length.max() / STEP))
    stray = rng.normal(0.0, 1.0, (int(wisp.max()) + 1, 2, 3))[wisp]
    own = rng.normal(0.0, 0.05, (len(wisp), 3))
    at = roots.points + 1e-4 * roots.normals
    ahead = unit(plan.way(at, np.zeros(len(at))) + 0.7 * roots.normals)
    ends = np.ceil(plan.length / STEP).astype(int)
    paths = [at]
    for i in range(count):
        along = np.full(len(at), i * STEP)
        wave = np.stack([np.cos(along / 0.04), np.sin(along / 0.03)], axis=1)
        want = unit(plan.way(at, along))
        want = want + plan.wild * np.einsum("nk,nkd->nd", wave, stray) + own
        ahead = unit(ahead + STEP / plan.turn * (want - ahead))
        nearest = tree.query(at, workers=-1)[1]
        normal = skin.normals[nearest]
        height = np.einsum("nd,nd->n", at - skin.points[nearest], normal)
        least = np.minimum(plan.above, 0.001 + 0.5 * along)
        lack = np.clip((least - height) / STEP, 0.0, 1.0)
        inward = np.minimum(np.einsum("nd,nd->n", ahead, normal), 0.0)
        held = unit(ahead - (lack * inward)[:, None] * normal)
        held = unit(held + 0.5 * lack[:, None] * normal)
        ahead = np.where((lack > 0.0)[:, None], held, ahead)
        at = at + STEP * ahead
        paths.append(at)
        if plan.cut is not None:
            ends = np.where(plan.cut(at), np.minimum(ends, i + 1), ends)
    return np.stack(paths, axis=1), np.maximum(ends, 2)


class Tie:
    """The way to a tie along the head, and from there on along a tail.

    Attributes:
        place: Of the tie, in metres, (3,) or of each hair (N, 3).
        tail: The way from there on, from points and lengths since, of all hairs.
    """

    def __init__(
        self,
        place: np.ndarray,
        chance: np.ndarray,
        tail: Callable[[np.ndarray, np.ndarray], np.ndarray],
    ) -> None:
        """Ask `chance` (N, 3) for where in the tie each hair goes through."""
        self.place = place + 0.012 * (chance - 0.5)
        self.tail = tail
        self.since = np.full(len(chance), np.inf)

    def __call__(self, points: np.ndarray, along: np.ndarray) -> np.ndarray:
        """Return the way of each hair, which is asked for once at each step."""
        far = np.linalg.norm(self.place - points, axis=1)
        self.since = np.where(far < 0.008, np.minimum(self.since, along), self.since)
        through = np.isfinite(self.since)
        tail = self.tail(points, np.where(through, along - self.since, 0.0))
        return np.where(through[:, None], tail, unit(self.place - points))


def spread(roots: Roots, least: float, most: float) -> np.ndarray:
    """Return lengths of wisps, evenly between two, in metres."""
    return least + (most - least) * roots.chance[:, 0]


def lie(roots: Roots, thick: float) -> np.ndarray:
    """Return how far hair lies above the skin: hair from higher up lies further out."""
    high = np.clip((roots.elevation + 30.0) / 110.0, 0.0, 1.0)
    return 0.002 + thick * (0.3 + 0.7 * high) * (0.3 + 0.7 * roots.chance[:, 1])


def aside(roots: Roots, part: float) -> np.ndarray:
    """Return the ways of roots, down and away from a parting at x = `part` metres."""
    side = np.where(roots.points[:, 0] > part, 1.0, -1.0)
    high = np.clip((roots.elevation - 20.0) / 50.0, 0.0, 1.0)
    front = np.clip(1.0 - np.abs(roots.azimuth) / 60.0, 0.0, 1.0)
    back = np.clip(np.abs(roots.azimuth) / 90.0 - 1.0, 0.0, 1.0)
    level = side[:, None] * LEFT + (back - 0.3 * front)[:, None] * 1.5 * BACK
    return unit(high[:, None] * level + DOWN * (1.05 - high)[:, None])


def hanging(
    off: np.ndarray, over: float
) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Return a way that starts off as given, (N, 3), and hangs after `over` metres."""

    def way(points: np.ndarray, along: np.ndarray) -> np.ndarray:
        del points
        fall = np.clip(along / over, 0.0, 1.0)[:, None]
        return unit((1.0 - fall) * off + fall * DOWN)

    return way


def to_waist(roots: Roots) -> Plan:
    """Parted in the middle and as long as to the waist, behind the shoulders."""
    hang = hanging(aside(roots, 0.0), 0.09)

    def way(points: np.ndarray, along: np.ndarray) -> np.ndarray:
        behind = np.where(points[:, 2] > -0.02, 0.8, 0.0) * (along > 0.10)
        return unit(hang(points, along) + behind[:, None] * BACK)

    return Plan(spread(roots, 0.48, 0.56), way, lie(roots, 0.015))


def over_shoulder(roots: Roots) -> Plan:
    """Long, parted on the right, all of it drawn over the left shoulder."""
    off = aside(roots, -0.03)
    goal = np.array([0.075, -0.075, 0.045])

    def way(points: np.ndarray, along: np.ndarray) -> np.ndarray:
        fall = np.clip(along / 0.10, 0.0, 1.0)[:, None]
        drawn = unit(goal + 0.03 * (roots.chance - 0.5) - points)
        drawn = np.where((points[:, 1] > -0.06)[:, None], drawn, DOWN)
        return unit((1.0 - fall) * off + fall * drawn)

    return Plan(spread(roots, 0.30, 0.38), way, lie(roots, 0.012))


def mullet(roots: Roots) -> Plan:
    """Short in front and at the sides, long behind."""
    behind = np.clip((np.abs(roots.azimuth) - 100.0) / 30.0, 0.0, 1.0)
    behind *= roots.elevation < 60.0
    length = spread(roots, 0.035, 0.055) + behind * spread(roots, 0.12, 0.18)
    flat = np.cross(roots.normals, np.cross(DOWN + 0.4 * BACK, roots.normals))
    front = np.clip(1.0 - np.abs(roots.azimuth) / 70.0, 0.0, 1.0)[:, None]
    off = unit(flat + front * (0.6 * UP - 0.4 * BACK))
    return Plan(length, hanging(off, 0.07), lie(roots, 0.012), wild=0.3)


def bowl(roots: Roots) -> Plan:
    """From the crown every way down, and cut off at one height all round."""
    out = roots.points - np.array([0.0, 0.0, -0.035])
    off = unit(out * [1.0, 0.0, 1.0])

    def way(points: np.ndarray, along: np.ndarray) -> np.ndarray:
        del points
        fall = np.clip(along / 0.05, 0.0, 1.0)[:, None]
        return unit((1.0 - fall) * off + (0.3 + fall) * DOWN)

    def cut(points: np.ndarray) -> np.ndarray:
        return points[:, 1] < 0.050 - 0.6 * np.clip(-points[:, 2], 0.0, 0.08)

    return Plan(spread(roots, 0.20, 0.22), way, lie(roots, 0.014), wild=0.08, cut=cut)


def pompadour(roots: Roots) -> Plan:
    """The front swept up and back in a roll, the sides short and combed back."""
    top = np.clip((roots.elevation - 32.0) / 12.0, 0.0, 1.0)
    front = top * np.clip(1.0 - np.abs(roots.azimuth) / 110.0, 0.0, 1.0)
    length = spread(roots, 0.02, 0.03) + top * spread(roots, 0.05, 0.08)
    above = 0.003 + 0.006 * top + 0.035 * front * (0.4 + 0.6 * roots.chance[:, 1])
    sides = unit(BACK + 0.35 * DOWN)

    def way(points: np.ndarray, along: np.ndarray) -> np.ndarray:
        del points
        rise = np.clip(1.0 - along / 0.045, 0.0, 1.0) * front
        back = sides + (top * 0.2)[:, None] * UP
        return unit(back + 2.0 * rise[:, None] * UP)

    return Plan(length, way, above, wild=0.1)


def windblown(roots: Roots) -> Plan:
    """Shoulder-length hair in a wind from its right front."""
    wind = unit(np.array([1.0, 0.25, -0.55]))

    def way(points: np.ndarray, along: np.ndarray) -> np.ndarray:
        del points
        fall = np.clip(along / 0.20, 0.0, 1.0)[:, None]
        return unit((1.0 - 0.5 * fall) * wind + 0.6 * fall * DOWN)

    return Plan(spread(roots, 0.12, 0.20), way, lie(roots, 0.03), wild=0.5)


def rows(roots: Roots) -> Plan:
    """Rows from the face to the nape with bare skin between, which hang from there."""
    across = 0.02 * (np.round(roots.points[:, 0] / 0.02))

    def way(points: np.ndarray, along: np.ndarray) -> np.ndarray:
        del along
        away = across - points[:, 0]
        # Back along the head until it falls away behind.
        behind = np.clip((-points[:, 2] - 0.02) / 0.05, 0.0, 1.0)[:, None]
        low = np.clip((0.02 - points[:, 1]) / 0.03, 0.0, 1.0)[:, None]
        ahead = (1.0 - behind) * BACK + (behind + low) * DOWN
        return unit(ahead + (80.0 * away)[:, None] * LEFT)

    above = 0.002 + 0.005 * roots.chance[:, 1]
    return Plan(spread(roots, 0.24, 0.28), way, above, turn=0.008, wild=0.08)


def side_tail(roots: Roots) -> Plan:
    """Tied low behind the left ear, the tail over the shoulder."""
    place = np.array([0.070, -0.030, -0.060])

    def tail(points: np.ndarray, since: np.ndarray) -> np.ndarray:
        out = np.clip(1.0 - since / 0.05, 0.0, 1.0)[:, None]
        forth = np.where(points[:, 2] < 0.03, 0.6, 0.0)[:, None]
        return unit(out * (LEFT + BACK) + DOWN - forth * BACK)

    way = Tie(place, roots.chance, tail)
    return Plan(spread(roots, 0.40, 0.48), way, lie(roots, 0.006), 0.01, wild=0.05)


def high_tail(roots: Roots) -> Plan:
    """Tied high at the back of the crown."""

    def tail(points: np.ndarray, since: np.ndarray) -> np.ndarray:
        del points
        out = np.clip(1.0 - since / 0.08, 0.0, 1.0)[:, None]
        return unit(out * (BACK + 0.5 * UP) + (1.0 - out) * DOWN)

    way = Tie(HIGH_TIE, roots.chance, tail)
    return Plan(spread(roots, 0.42, 0.50), way, lie(roots, 0.006), 0.01, wild=0.06)


def winding(
    middle: np.ndarray, axis: np.ndarray, size: float, roots: Roots
) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Return the way around a knot about `middle`, as wide as `size`, in metres."""
    wide = size * (0.35 + 0.65 * roots.chance[:, 1])[:, None]
    deep = size * 0.6 * (2.0 * roots.chance[:, 2] - 1.0)[:, None]

    def way(points: np.ndarray, along: np.ndarray) -> np.ndarray:
        del along
        off = points - middle
        high = (off @ axis)[:, None]
        out = off - high * axis
        far = np.linalg.norm(out, axis=1, keepdims=True)
        out = out / np.maximum(far, 1e-4)
        round_ = np.cross(axis, out)
        return unit(round_ + (wide - far) / 0.015 * out + (deep - high) / 0.03 * axis)

    return way


def low_bun(roots: Roots) -> Plan:
    """Wound to a knot in the nape."""
    axis = unit(np.array([0.0, 0.15, -1.0]))
    place = np.array([0.0, -0.015, -0.085])
    tail = winding(place + 0.025 * axis, axis, 0.035, roots)
    way = Tie(place, roots.chance, tail)
    return Plan(spread(roots, 0.34, 0.42), way, lie(roots, 0.006), 0.01, wild=0.05)


def top_knot(roots: Roots) -> Plan:
    """Shorn at the sides and behind, the rest wound to a knot on top."""
    long = roots.elevation > 38.0
    axis = unit(np.array([0.0, 1.0, -0.5]))
    place = np.array([0.0, 0.140, -0.045])
    tail = winding(place + 0.020 * axis, axis, 0.026, roots)
    tied = Tie(place, roots.chance, tail)

    def way(points: np.ndarray, along: np.ndarray) -> np.ndarray:
        flat = 0.6 * roots.normals + DOWN
        return np.where(long[:, None], tied(points, along), flat)

    length = np.where(long, spread(roots, 0.30, 0.38), spread(roots, 0.005, 0.007))
    return Plan(length, way, lie(roots, 0.006), 0.01, wild=0.05)


def puffs(roots: Roots) -> Plan:
    """Parted in the middle and tied to two puffs of kinky hair."""
    side = np.where(roots.points[:, 0] > 0.0, 1.0, -1.0)[:, None]
    place = side * 0.075 * LEFT + np.array([0.0, 0.105, -0.030])
    out = unit(roots.chance - 0.5 + 1e-3)
    out = unit(out + 0.8 * (side * LEFT + 0.6 * UP))

    def tail(points: np.ndarray, since: np.ndarray) -> np.ndarray:
        del points, since
        return out

    way = Tie(place, roots.chance, tail)
    length = np.linalg.norm(place - roots.points, axis=1) * 1.25
    return Plan(length + spread(roots, 0.04, 0.07), way, lie(roots, 0.005), 0.01)


def tousled(roots: Roots) -> Plan:
    """Of 3 to 8 cm, every way."""
    off = unit(roots.chance - 0.5 + 1e-3)
    flat = off - np.einsum("nd,nd->n", off, roots.normals)[:, None] * roots.normals

    def way(points: np.ndarray, along: np.ndarray) -> np.ndarray:
        del points
        fall = np.clip(along / 0.08, 0.0, 1.0)[:, None]
        return unit(unit(flat) + 0.3 * fall * DOWN)

    return Plan(spread(roots, 0.03, 0.08), way, lie(roots, 0.03), wild=0.4)


def bobbed(roots: Roots) -> Plan:
    """To the chin, parted on the left, ends turned in."""
    hang = hanging(aside(roots, 0.03), 0.09)

    def way(points: np.ndarray, along: np.ndarray) -> np.ndarray:
        turned = np.clip((along - 0.15) / 0.05, 0.0, 1.0)[:, None]
        inward = -points * [1.0, 0.0, 1.0]
        return unit(hang(points, along) + turned * unit(inward))

    def cut(points: np.ndarray) -> np.ndarray:
        return points[:, 1] < -0.055

    return Plan(spread(roots, 0.26, 0.28), way, lie(roots, 0.014), wild=0.1, cut=cut)


STYLES = {
    "to-the-waist": Style(to_waist),
    "over-a-shoulder": Style(over_shoulder),
    "mullet": Style(mullet),
    "bowl-cut": Style(bowl, 24_000),
    "pompadour": Style(pompadour, 26_000),
    "windblown": Style(windblown),
    "rows": Style(rows, 24_000),
    "side-tail": Style(side_tail),
    "high-tail": Style(high_tail),
    "low-bun": Style(low_bun),
    "top-knot": Style(top_knot, 24_000),
    "puffs": Style(puffs, 20_000, 8),
    "tousled": Style(tousled, 20_000, 10),
    "bobbed": Style(bobbed, 22_000),
}
