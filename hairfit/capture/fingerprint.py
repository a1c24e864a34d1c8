"""A short name of a capture's content: work on the same content can be taken up."""

import hashlib

import numpy as np

from .capture import Capture


def fingerprint(capture: Capture) -> str:
    """Return a hash of all that a fit sees of a capture, in hexadecimal."""
    digest = hashlib.sha256()
    for view in capture.views:
        digest.update(f"{view.name} {view.camera.width} {view.camera.height}".encode())
        for array in (view.camera.K, view.camera.cam_from_world, view.image, view.hair):
            update(digest, array)
        update(digest, view.body)
    update(digest, None if capture.head is None else capture.head.vertices)
    update(digest, None if capture.head is None else capture.head.faces)
    update(digest, None if capture.scalp is None else capture.scalp.control)
    return digest.hexdigest()


def update(digest: "hashlib._Hash", array: object) -> None:
    """Add an array, or that there is none, to a hash."""
    if array is None:
        digest.update(b"none")
        return
    values = np.ascontiguousarray(np.asarray(array))
    digest.update(f"{values.dtype} {values.shape}".encode())
    digest.update(values.data)
