import dataclasses

import cv2
import jax.numpy as jnp
import numpy as np
import pytest
from tiny_capture import (
    HEIGHT,
    NAMES,
    WIDTH,
    read_cameras_json,
    write_cameras,
    write_tiny_capture,
)

from hairfit import errors
from hairfit.capture import load_capture, require_for_fit
from hairfit.capture.fingerprint import fingerprint


@pytest.fixture
def folder(tmp_path):
    return write_tiny_capture(tmp_path / "tiny")


def test_a_capture_holds_all_views_in_linear_light(folder):
    capture = load_capture(folder)
    assert tuple(view.name for view in capture.views) == NAMES
    view = capture.views[0]
    assert view.image.shape == (HEIGHT, WIDTH, 3)
    assert view.image.dtype == np.float32
    # The middle of the cap is sRGB (60, 40, 20) and hair, the ground 180 and neither.
    expected = [0.04519, 0.02122, 0.00700]
    assert np.allclose(view.image[20, 24], expected, atol=1e-5)
    assert view.hair[20, 24] and not view.hair[0, 0]
    assert view.body is not None and view.body[40, 24]
    assert np.allclose(view.camera.centre, [0, 0, 1], atol=1e-12)
    assert require_for_fit(capture) is capture.head


def test_only_chosen_views_are_read(folder):
    (folder / "images/01.png").write_text("not a picture")
    capture = load_capture(folder, "00,02.png")
    assert [view.name for view in capture.views] == ["00", "02"]


def test_names_in_a_list_are_never_a_count(folder):
    views = read_cameras_json(folder)
    assert len(load_capture(folder, ["01"]).views) == 1
    write_cameras(folder, views[:2])
    with pytest.raises(errors.InputError, match="no view '2'; the capture has 00, 01"):
        load_capture(folder, ["2"])


def test_a_picture_without_a_camera_is_noted(folder):
    write_cameras(folder, read_cameras_json(folder)[:2])
    (note,) = load_capture(folder).notes
    assert note.endswith("02.png' has no camera in 'cameras.json' and is left aside.")


def test_masks_of_the_body_and_the_head_may_be_absent(folder):
    (folder / "masks/body/00.png").unlink()
    (folder / "head.obj").unlink()
    capture = load_capture(folder)
    assert capture.views[0].body is None and capture.head is None
    with pytest.raises(errors.InputError, match="no 'head.obj' in .* put a mesh"):
        require_for_fit(capture)


def test_views_from_one_side_are_refused(folder):
    views = read_cameras_json(folder)
    for view in views[1:]:
        view["cam_from_world"] = views[0]["cam_from_world"]
    write_cameras(folder, views)
    with pytest.raises(errors.InputError, match="taken from the same side; add some"):
        require_for_fit(load_capture(folder))


def test_large_photographs_are_reduced_with_their_cameras(folder):
    small = load_capture(folder, longest_side=32).views[0]
    whole = load_capture(folder).views[0]
    assert small.image.shape == (32, 24, 3) and small.hair.shape == (32, 24)
    p_world = jnp.array([0.03, 0.05, 0.02])
    expected = whole.camera.project(p_world).pixel / 2
    assert np.allclose(small.camera.project(p_world).pixel, expected, atol=1e-9)
    assert np.isclose(small.image.mean(), whole.image.mean(), atol=1e-4)


def test_distortion_is_taken_out(folder):
    plain = load_capture(folder).views[0]
    # Photograph the same scene with a lens: move every pixel as OpenCV's model says.
    views = read_cameras_json(folder)
    distortion = [-12.0, 0.0, 0.0, 0.0]
    K = np.array(views[0]["K"], float)
    K[:2, 2] -= 0.5
    x, y = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    at = np.stack([x, y], -1).reshape(-1, 1, 2).astype(float)
    ideal = cv2.undistortPoints(at, K, np.array(distortion), P=K)
    maps = ideal.reshape(HEIGHT, WIDTH, 2).astype(np.float32)
    for path in (folder / "images/00.png", folder / "masks/hair/00.png"):
        seen = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        assert seen is not None
        moved = cv2.remap(seen, maps[..., 0], maps[..., 1], cv2.INTER_LINEAR)
        cv2.imwrite(str(path), moved)
    bent = load_capture(folder).views[0]
    views[0]["distortion"] = distortion
    write_cameras(folder, views)
    straight = load_capture(folder).views[0]
    assert np.mean(straight.hair != plain.hair) < 0.5 * np.mean(bent.hair != plain.hair)
    error = np.abs(straight.image - plain.image)[8:-8, 8:-8].mean()
    assert error < 0.5 * np.abs(bent.image - plain.image)[8:-8, 8:-8].mean()


def test_the_fingerprint_follows_the_content(folder):
    capture = load_capture(folder)
    assert fingerprint(capture) == fingerprint(load_capture(folder))
    view = capture.views[0]
    hair = view.hair.copy()
    hair[0, 0] = True
    views = (dataclasses.replace(view, hair=hair), *capture.views[1:])
    assert fingerprint(dataclasses.replace(capture, views=views)) != fingerprint(
        capture
    )
    headless = dataclasses.replace(capture, head=None)
    assert fingerprint(headless) != fingerprint(capture)


def test_the_reference_captures_load(captures):
    capture = load_capture(captures / "ruby", "00,04")
    assert capture.views[0].image.shape == (960, 768, 3)
    assert require_for_fit(capture).vertices.shape[1] == 3
