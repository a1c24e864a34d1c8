"""Photographs that contradict the others: which, why, and what a fit should do.

Evidence, from strong to weak: the person's mask against the outline of the head; hair
masks against the hull of the others; a picture against its own masks; its brightness.
A photograph is accused only where it stands out from the others and, for a camera or
a mirror, where the repair mends what is wrong.
"""

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..capture.capture import View, reduce_view
from ..capture.photos import srgb_from_linear
from ..capture.shake import Smear
from ..render.camera import Camera
from ..types import Mesh
from .agreement import ask_all, disagreement_without, find_candidates
from .registration import Misfit, Registered, misfit, register

LONGEST_SIDE = 320  # pixels of the shrunken pictures
OUTLINE_SIDE = 640  # of those whose outlines are compared
MOST_ACCUSED = 0.34  # share of the views; where more stand out, the head is wrong
# A misfit stands out beyond `base + factor * median of the others`, in shares of the
# head's area. The bases leave room for outlines drawn by hand.
ODD_OUTSIDE = (0.008, 3.0)
ODD_BARE = (0.02, 2.5)
ODD_TOTAL = (0.0015, 2.0)
LEFT_TOTAL = (0.015, 1.7)  # after a repair: a third of a pixel may remain
MENDED = 0.6  # a repair leaves at most this share of a misfit
LEAST_MENDED = 0.002  # and takes away at least this much
LARGEST_TURN = 12.0  # degrees: beyond it the repair is a guess
BINS = 10  # of each colour channel
LEAST_DIFFERENT = 0.01  # share of the hair that a mirror moves, to judge a mirror
CLIPPED, BLACK = 254.0 / 255.0, 1.0 / 255.0  # sRGB
ODD_STOPS, ODD_FROM_NEXT = 1.3, 0.7

Kind = Literal["mask", "camera", "exposure", "mirrored", "shaken"]
Remedy = Literal[
    "open mask",
    "turn camera",
    "flip all",
    "flip image",
    "leave out",
    "mute clipped",
    "look smaller",
]


class Doubt(NamedTuple):
    """What is wrong with one photograph.

    Attributes:
        view: Its name.
        kind: What it is.
        strength: How much, in `unit`.
        unit: "degrees" of a camera, "stops" of an exposure, else "share": of the head
            or the hair that is out of place, from 0 to 1.
        sentence: The same for the user to read.
        remedy: What the fit should do.
        camera: The corrected camera of "turn camera".
    """

    view: str
    kind: Kind
    strength: float
    unit: Literal["degrees", "stops", "share"]
    sentence: str
    remedy: Remedy
    camera: Camera | None = None


class Shot(NamedTuple):
    """One photograph, shrunken, and the depth of the head in it, in metres."""

    view: View
    depth: Float[np.ndarray, "height width"]


def find_suspects(
    views: Sequence[View],
    depths: Sequence[Float[np.ndarray, "_height _width"]],
    head: Mesh,
) -> list[Doubt]:
    """Return what is wrong with photographs, at most one doubt each.

    Args:
        views: The photographs.
        depths: Depth of the head in each of them, in metres.
        head: The head.
    """
    pairs = list(zip(views, depths, strict=True))
    found = doubt_outlines([shrink(*pair, OUTLINE_SIDE) for pair in pairs], head)
    shots = [shrink(*pair) for pair in pairs]
    sound = [shot for shot in shots if shot.view.name not in {d.view for d in found}]
    # Photographs that are accused already would accuse others.
    found += doubt_hair(sound, head)
    accused = {doubt.view for doubt in found}
    found += [
        doubt
        for shot in shots
        if shot.view.name not in accused
        and (doubt := doubt_mirror(shot.view)) is not None
    ]
    accused = {doubt.view for doubt in found}
    dazzled = doubt_exposure([shot.view for shot in shots])
    found += [doubt for doubt in dazzled if doubt.view not in accused]
    full = {view.name: view.camera for view in views}
    return [
        doubt
        if doubt.camera is None
        else doubt._replace(camera=at_size_of(full[doubt.view], doubt.camera))
        for doubt in found
    ]


def at_size_of(camera: Camera, posed: Camera) -> Camera:
    """Return a camera in the pose of another."""
    pose = posed.cam_from_world.astype(camera.cam_from_world.dtype)
    return Camera(camera.K, pose, camera.width, camera.height)


def shrink(
    view: View,
    depth: Float[np.ndarray, "height width"],
    longest_side: int = LONGEST_SIDE,
) -> Shot:
    """Return a photograph and its depths shrunken: means of what pixels see."""
    import cv2

    small = reduce_view(view, longest_side)
    size = (small.camera.width, small.camera.height)
    seen = np.isfinite(depth)
    share = cv2.resize(seen.astype(np.float64), size, interpolation=cv2.INTER_AREA)
    near = np.where(seen, depth, 0.0)
    near = cv2.resize(near, size, interpolation=cv2.INTER_AREA)
    return Shot(small, np.where(share > 0.5, near / np.maximum(share, 0.5), np.inf))


def flipped(view: View) -> View:
    """Return a photograph with picture and masks mirrored, not the camera."""
    body = None if view.body is None else view.body[:, ::-1]
    return View(view.name, view.camera, view.image[:, ::-1], view.hair[:, ::-1], body)


# --- The person against the outline of the head ------------------------------------


def doubt_outlines(shots: Sequence[Shot], head: Mesh) -> list[Doubt]:
    """Return the photographs in which the head does not fit the person."""
    known = [shot for shot in shots if shot.view.body is not None]
    if len(known) < 3:
        return []
    found = [outline_misfit(shot.view, shot.depth) for shot in known]
    doubts = []
    for k, shot in enumerate(known):
        others = [m for j, m in enumerate(found) if j != k]
        typical = Misfit(*np.median(np.array(others), axis=0).tolist())
        doubt = judge_outline(shot, found[k], typical, head)
        if doubt is not None:
            doubts.append((found[k].total, doubt))
    if len(doubts) > MOST_ACCUSED * len(known):
        return []
    return [doubt for _, doubt in doubts]


def outline_misfit(view: View, depth: Float[np.ndarray, "height width"]) -> Misfit:
    """Return how far the person of a photograph is from the outline of the head."""
    return misfit(np.isfinite(depth), np.asarray(view.body), view.hair)


def judge_outline(
    shot: Shot, found: Misfit, typical: Misfit, head: Mesh
) -> Doubt | None:
    """Return what is wrong with a photograph, given the misfit of typical others."""

    def odd(value: float, usual: float, limits: tuple[float, float]) -> bool:
        return value > limits[0] + limits[1] * usual

    view = shot.view
    outside = odd(found.outside, typical.outside, ODD_OUTSIDE)
    bare = odd(found.bare, typical.bare, ODD_BARE)
    if not (outside or bare or odd(found.total, typical.total, ODD_TOTAL)):
        return None
    flip = outline_misfit(flipped(view), shot.depth)
    turned = register(view, shot.depth, head)
    gain = turned.before.total - turned.after.total
    mends = turned.after.total < MENDED * turned.before.total and gain > LEAST_MENDED
    # Mended, it must be as good as the others.
    mends &= not odd(turned.after.total, typical.total, LEFT_TOTAL)
    flip_gain = found.total - flip.total
    # Both are measured against the same outline: gains, not what is left, compare.
    if (
        flip.total < MENDED * found.total
        and flip_gain > LEAST_MENDED
        and (not mends or flip_gain >= gain)
    ):
        return mirrored_doubt(view.name, found.total - flip.total)
    if mends and turned.turn_deg < LARGEST_TURN:
        return turned_doubt(view.name, turned)
    if outside:
        return lost_doubt(view.name, found.total)
    return mask_doubt(view.name, found.bare) if bare else None


def mirrored_doubt(name: str, share: float) -> Doubt:
    """Return the doubt about a photograph that is mirrored with its masks."""
    sentence = (
        f"photograph '{name}' and its masks are mirrored, left for right: mirrored "
        f"back they fit the others, as they are {percent(share)} of the outline is out "
        "of place. The fit used them mirrored back; mirror the files."
    )
    return Doubt(name, "mirrored", share, "share", sentence, "flip all")


def turned_doubt(name: str, found: Registered) -> Doubt:
    """Return the doubt about a camera that can be corrected."""
    how = "about the head" if found.about_head else "where it stands"
    sentence = (
        f"the camera of photograph '{name}' is off: turned by {found.turn_deg:.1f} "
        f"degrees {how} the head fits the person, who is {percent(found.before.total)} "
        "out of place otherwise. The fit used the turned camera; check "
        "'cameras.json'."
    )
    return Doubt(
        name,
        "camera",
        found.turn_deg,
        "degrees",
        sentence,
        "turn camera",
        found.camera,
    )


def lost_doubt(name: str, share: float) -> Doubt:
    """Return the doubt about a photograph whose head is elsewhere, beyond repair."""
    sentence = (
        f"the camera of photograph '{name}' does not fit: {percent(share)} of the head "
        "lies beside the person. The fit left the photograph out; find its camera "
        "anew."
    )
    return Doubt(name, "camera", share, "share", sentence, "leave out")


def mask_doubt(name: str, share: float) -> Doubt:
    """Return the doubt about a hair mask."""
    sentence = (
        f"the hair mask of photograph '{name}' is wrong: {percent(share)} of what it "
        "or the others show contradicts it. The fit did not let it cut hair away; "
        "paint it anew."
    )
    return Doubt(name, "mask", share, "share", sentence, "open mask")


def shaken_doubt(name: str, smear: Smear) -> Doubt:
    """Return the doubt about a picture that is smeared."""
    sentence = (
        f"photograph '{name}' is shaken: {percent(smear.share)} of the hair seems to "
        f"run as the picture is smeared, {math.degrees(smear.angle):.0f} degrees from "
        "level, across what a smaller one shows. The fit took directions of hair from "
        "the smaller one; take the photograph again with a shorter exposure."
    )
    return Doubt(name, "shaken", smear.share, "share", sentence, "look smaller")


def percent(share: float) -> str:
    """Return a share in words."""
    return f"{100 * share:.1f} %"


# --- Hair masks against each other --------------------------------------------------


def doubt_hair(shots: Sequence[Shot], head: Mesh) -> list[Doubt]:
    """Return the photograph without which the hair masks of the others agree."""
    count = len(shots)
    # The hull of one photograph is no hull: two must be left besides the pair.
    if count < 4:
        return []
    left = disagreement(shots, head)
    culprit = int(np.argmin(left))
    others = np.delete(left, culprit)
    # Few photographs leave a loose hull, which explains less surely.
    least, usual = (0.002, 0.003) if count > 5 else (0.004, 0.008)
    if others.min() < least + 3 * left[culprit]:
        return []
    if np.median(others) < usual + 4 * left[culprit]:
        return []
    share = float(np.median(others) - left[culprit])
    view, depth = shots[culprit]
    mirror = [*shots]
    mirror[culprit] = Shot(flipped(view), depth)
    # The person has to fit as well mirrored as not.
    fits = view.body is None or (
        outline_misfit(flipped(view), depth).total
        < outline_misfit(view, depth).total + LEAST_MENDED
    )
    if fits and disagreement(mirror, head).max() < 0.4 * np.median(others):
        return [mirrored_doubt(view.name, share)]
    if view.body is not None:
        return [mask_doubt(view.name, share)]
    sentence = (
        f"photograph '{view.name}' contradicts the others, by its hair mask or its "
        f"camera: without it {percent(share)} more of their hair is explained. The fit "
        "left it out; look at the mask, and find the camera anew."
    )
    return [Doubt(view.name, "mask", share, "share", sentence, "leave out")]


def disagreement(shots: Sequence[Shot], head: Mesh) -> Float[np.ndarray, " views"]:
    """Return how far hair masks disagree when each photograph is left out."""
    views, depths = zip(*shots, strict=True)
    points = find_candidates(views, depths, head, 2)
    return disagreement_without(ask_all(points, views, depths), views)


# --- A picture against its own masks ------------------------------------------------


def doubt_mirror(view: View) -> Doubt | None:
    """Return the doubt about a picture that fits its masks only when mirrored.

    Colours of hair, person and background are learnt where masks and mirrored masks
    agree; where they differ, the colours tell which holds.
    """
    label = labels(view)
    same = label == label[:, ::-1]
    if (~same).sum() < LEAST_DIFFERENT * view.hair.sum():
        return None
    code = colour_code(view.image)
    weight = np.ones((3, BINS**3)) * 1e-3
    np.add.at(weight, (label[same], code[same]), 1.0)
    log = np.log(weight / weight.sum(axis=1, keepdims=True))
    mirrored = label[:, ::-1]
    gain = (log[label, code] - log[mirrored, code])[~same]
    # Colours that were never learnt, and shadows, may say anything: not too much.
    if np.median(gain) > -0.5 or np.clip(gain, -3, 3).mean() > -0.5:
        return None
    share = float((~same).sum() / max(view.hair.sum(), 1))
    sentence = (
        f"the picture '{view.name}' is mirrored, left for right, but its masks are "
        f"not: in {percent(share)} of the hair's area its colours fit the masks only "
        "when mirrored. The fit used the picture mirrored back; mirror the file."
    )
    return Doubt(view.name, "mirrored", share, "share", sentence, "flip image")


def labels(view: View) -> Int[np.ndarray, "height width"]:
    """Return 1 where there is hair, 2 where there is the rest of a person, else 0."""
    body = np.zeros_like(view.hair) if view.body is None else view.body
    return np.where(view.hair, 1, np.where(body, 2, 0))


def colour_code(
    image: Float[np.ndarray, "height width 3"],
) -> Int[np.ndarray, "height width"]:
    """Return the number of the colour of each pixel: its bins of sRGB."""
    shade = np.minimum((srgb_from_linear(image) * BINS).astype(int), BINS - 1)
    return (shade[..., 0] * BINS + shade[..., 1]) * BINS + shade[..., 2]


# --- Brightness ----------------------------------------------------------------------


def doubt_exposure(views: Sequence[View]) -> list[Doubt]:
    """Return photographs that are much brighter or darker than all others."""
    if len(views) < 3:
        return []
    stops = np.array(
        [np.log2(max(float(np.median(v.image[v.hair])), 1e-6)) for v in views]
    )
    doubts = []
    for k, view in enumerate(views):
        others = np.delete(stops, k)
        off = stops[k] - np.median(others)
        next_one = others.max() if off > 0 else others.min()
        if abs(off) < ODD_STOPS or abs(stops[k] - next_one) < ODD_FROM_NEXT:
            continue
        lost = clipped(view)[person(view)].mean()
        bright = "brighter" if off > 0 else "darker"
        sentence = (
            f"photograph '{view.name}' is {abs(off):.1f} stops {bright} than the "
            f"others, and {percent(lost)} of the person is clipped or black in it. The "
            "fit took no direction of hair from such pixels; expose it as the others."
        )
        doubts.append(
            Doubt(view.name, "exposure", float(off), "stops", sentence, "mute clipped")
        )
    return doubts


def person(view: View) -> Bool[np.ndarray, "height width"]:
    """Return where a photograph shows the person, with the hair."""
    return view.hair if view.body is None else view.hair | view.body


def clipped(view: View) -> Bool[np.ndarray, "height width"]:
    """Return the pixels in which a channel is clipped or all are black."""
    shade = srgb_from_linear(view.image)
    return (shade.max(axis=-1) >= CLIPPED) | (shade.max(axis=-1) <= BLACK)
