"""Every refusal of bad input, read as the user reads it."""

import json
import math
import shutil

import cv2
import numpy as np
import pytest
import trimesh
from tiny_capture import (
    HEIGHT,
    WIDTH,
    read_cameras_json,
    write_cameras,
    write_tiny_capture,
)

from hairfit.cli import main


@pytest.fixture
def capture(tmp_path):
    return write_tiny_capture(tmp_path / "tiny")


@pytest.fixture
def refusal(tmp_path, capture, capsys):
    """Run `hairfit fit` on the capture, and return the sentence that refuses it."""

    def run(*options, out=tmp_path / "result"):
        before = snapshot(tmp_path)
        status = main(["fit", str(capture), "--out", str(out), "--quiet", *options])
        printed = capsys.readouterr()
        assert status == 2
        assert printed.out == ""
        (line,) = printed.err.splitlines()
        assert line.startswith("hairfit: ") and line.endswith(".")
        assert snapshot(tmp_path) == before
        return line

    return run


def snapshot(folder):
    return {
        path: path.read_bytes() if path.is_file() else None
        for path in sorted(folder.rglob("*"))
    }


def spoil(capture, index, **changes):
    views = read_cameras_json(capture)
    views[index] |= changes
    write_cameras(capture, views)


def paint(path, value, shape=(HEIGHT, WIDTH)):
    cv2.imwrite(str(path), np.full(shape, value, np.uint8))


def export(capture, mesh):
    mesh.export(capture / "head.obj")


def ball():
    return trimesh.creation.icosphere(subdivisions=3, radius=0.1)


def test_no_folder(refusal, capture):
    shutil.rmtree(capture)
    assert "no folder '" in refusal() and "give a capture" in refusal()


def test_an_empty_folder(refusal, capture):
    shutil.rmtree(capture)
    capture.mkdir()
    line = refusal()
    assert "tiny' is empty; put the photographs into" in line


def test_a_folder_without_images(refusal, capture):
    shutil.rmtree(capture / "images")
    line = refusal()
    assert "images'; put the photographs into it as PNG or JPEG files." in line


def test_no_picture_among_the_images(refusal, capture):
    for path in (capture / "images").iterdir():
        path.unlink()
    (capture / "images/readme.txt").write_text("later")
    assert "no photographs in '" in refusal()


def test_a_text_file_named_png(refusal, capture):
    (capture / "images/01.png").write_text("I am a picture, believe me.")
    line = refusal()
    assert "images/01.png' is not a picture, whatever its name says; replace" in line


def test_an_empty_file_named_png(refusal, capture):
    (capture / "images/01.png").write_bytes(b"")
    assert "images/01.png' is not a picture" in refusal()


def test_half_of_a_picture(refusal, capture):
    data = (capture / "images/01.png").read_bytes()
    (capture / "images/01.png").write_bytes(data[:40])
    assert "images/01.png' is not a picture" in refusal()


def test_a_picture_of_another_size_than_its_camera(refusal, capture):
    paint(capture / "images/02.png", 9, (HEIGHT, WIDTH + 8, 3))
    line = refusal()
    assert "images/02.png' has 56x64 pixels but its camera 48x64; use the" in line


def test_a_camera_without_a_picture(refusal, capture):
    (capture / "images/01.png").unlink()
    line = refusal()
    assert "camera '01' in '" in line and "has no picture in '" in line
    assert "add it, or choose the others with --views." in line


def test_no_cameras(refusal, capture):
    (capture / "cameras.json").unlink()
    assert "no 'cameras.json' in '" in refusal()


@pytest.mark.parametrize("text", ["{", "[]", '{"cameras": []}'])
def test_cameras_that_are_not_json_with_views(refusal, capture, text):
    (capture / "cameras.json").write_text(text)
    assert "cameras.json' is not JSON with a list 'views'" in refusal()


def test_no_views_among_the_cameras(refusal, capture):
    write_cameras(capture, [])
    assert "cameras.json' lists no 'views'; add one for every photograph." in refusal()


def test_a_view_without_a_name(refusal, capture):
    spoil(capture, 1, name=None)
    assert "has a view without a 'name'; give it its picture's name." in refusal()


def test_two_cameras_of_one_name(refusal, capture):
    spoil(capture, 1, name="00.jpg")
    assert "has more than one camera named '00'; keep one of them." in refusal()


@pytest.mark.parametrize("key", ["K", "cam_from_world"])
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_numbers_in_the_cameras_that_are_not_finite(refusal, capture, key, value):
    matrix = read_cameras_json(capture)[1][key]
    matrix[0][2] = value
    spoil(capture, 1, **{key: matrix})
    line = refusal()
    assert "camera '01' in '" in line
    assert f"has numbers in '{key}' that are not finite" in line
    assert "remove this camera and its picture." in line


@pytest.mark.parametrize("matrix", [None, [[1, 0], [0, 1]], "K", [["a"] * 3] * 3])
def test_a_matrix_of_another_shape(refusal, capture, matrix):
    spoil(capture, 1, K=matrix)
    assert "has no 3x3 matrix 'K'; add it as a list of rows." in refusal()


def test_a_camera_without_a_size(refusal, capture):
    spoil(capture, 1, width=None)
    assert "has the size None x 64; give 'width' and 'height' in pixels." in refusal()


def test_a_focal_length_of_zero(refusal, capture):
    spoil(capture, 1, K=[[0, 0, 24], [0, 250, 32], [0, 0, 1]])
    assert "the focal lengths 0 and 250 in 'K'; they must be positive" in refusal()


def test_an_intrinsic_matrix_by_columns(refusal, capture):
    spoil(capture, 1, K=[[250, 0, 0], [0, 250, 0], [24, 32, 1]])
    assert "has a 'K' that is not [[fx, s, cx]" in refusal()


@pytest.mark.parametrize("rotation", [np.eye(3) * 1.5, np.diag([1.0, 1.0, -1.0])])
def test_a_pose_that_is_not_a_rotation(refusal, capture, rotation):
    pose = np.eye(4)
    pose[:3, :3] = rotation
    spoil(capture, 1, cam_from_world=pose.tolist())
    line = refusal()
    assert "whose upper left 3x3 is not a rotation; it must have no scale" in line


def test_a_pose_by_columns(refusal, capture):
    pose = np.array(read_cameras_json(capture)[1]["cam_from_world"]).T
    spoil(capture, 1, cam_from_world=pose.tolist())
    assert "whose last row is not 0 0 0 1; write it by rows." in refusal()


def test_a_distortion_that_opencv_does_not_know(refusal, capture):
    spoil(capture, 1, distortion=[0.1, 0.2])
    assert "not a list of 4, 5, 8, 12 or 14 numbers in OpenCV's order" in refusal()


def test_cameras_that_all_look_away_from_the_head(refusal, capture):
    for k in range(3):
        turn_round(capture, k)
    line = refusal()
    assert "all cameras in '" in line and "look away from the head '" in line
    assert "'cam_from_world' must map the world to the camera" in line


def test_cameras_that_look_away_from_each_other(refusal, capture):
    (capture / "head.obj").unlink()
    for k in range(3):
        turn_round(capture, k)
    line = refusal()
    assert "look away from each other instead of at one head;" in line


def test_one_camera_that_looks_away(refusal, capture):
    turn_round(capture, 1)
    line = refusal()
    assert "camera '01' in '" in line and "looks away from the head '" in line
    assert "leave it out with --views" in line


def turn_round(capture, index):
    pose = np.array(read_cameras_json(capture)[index]["cam_from_world"])
    half_turn = np.diag([-1.0, 1.0, -1.0, 1.0])
    spoil(capture, index, cam_from_world=(half_turn @ pose).tolist())


def test_no_hair_mask(refusal, capture):
    (capture / "masks/hair/01.png").unlink()
    line = refusal()
    assert "no hair mask '" in line and "masks/hair/01.png'; paint one" in line
    assert "of 48x64 pixels, white where there is hair" in line


def test_an_empty_hair_mask(refusal, capture):
    paint(capture / "masks/hair/01.png", 0)
    line = refusal()
    assert "masks/hair/01.png' is empty; paint the hair white in it" in line


@pytest.mark.parametrize("part", ["hair", "body"])
def test_a_mask_of_the_wrong_size(refusal, capture, part):
    paint(capture / f"masks/{part}/01.png", 255, (10, 12))
    line = refusal()
    assert f"masks/{part}/01.png' has 12x10 pixels but its photograph 48x64;" in line
    assert "make it again at that size." in line


@pytest.mark.parametrize("part", ["hair", "body"])
def test_a_mask_that_is_all_white(refusal, capture, part):
    paint(capture / f"masks/{part}/01.png", 255)
    line = refusal()
    assert f"masks/{part}/01.png' is all white; paint black what is outside." in line


def test_no_head(refusal, capture):
    (capture / "head.obj").unlink()
    line = refusal()
    assert "no 'head.obj' in '" in line and "put a mesh of the head there" in line


def test_a_head_with_a_hole_in_its_cranium(refusal, capture):
    mesh = ball()
    mesh.update_faces(mesh.triangles_center[:, 1] < 0.07)
    export(capture, mesh)
    line = refusal()
    assert "head.obj' has a hole in its cranium (" in line
    assert "close it (an open neck may stay)" in line


@pytest.mark.parametrize(
    "unit, factor, there", [("milli", 1000, "0.001"), ("centi", 100, "0.01")]
)
def test_a_head_that_is_not_in_metres(refusal, capture, unit, factor, there):
    mesh = ball()
    mesh.apply_scale(factor)
    export(capture, mesh)
    line = refusal()
    assert f"head.obj' is in {unit}metres but the cameras are not;" in line
    assert f"scale it by {there} to metres." in line


def test_a_head_and_cameras_in_millimetres(refusal, capture):
    mesh = ball()
    mesh.apply_scale(1000)
    export(capture, mesh)
    views = read_cameras_json(capture)
    for view in views:
        view["cam_from_world"][2][3] = 1000.0
    write_cameras(capture, views)
    line = refusal()
    assert "wide, which is not in metres; scale it by 0.001, and the cameras" in line


def test_a_head_that_is_no_mesh(refusal, capture):
    (capture / "head.obj").write_text("hello\n")
    assert "head.obj'" in refusal()


def test_a_scalp_of_another_size(refusal, capture):
    content = {"units": "metre", "control": [[[0, 0, 0]] * 3] * 3}
    (capture / "scalp.json").write_text(json.dumps(content))
    line = refusal()
    assert (
        "scalp.json' must hold 13x13 finite points under 'control', not 3x3x3" in line
    )


def test_a_scalp_that_is_not_json(refusal, capture):
    (capture / "scalp.json").write_text("")
    assert "scalp.json' is not JSON with 13x13 points under 'control'" in refusal()


@pytest.mark.parametrize("unit, words", [("mm", "is in 'mm'; write"), ("metre", "off")])
def test_a_scalp_in_millimetres(refusal, capture, unit, words):
    content = {"units": unit, "control": np.full((13, 13, 3), 80.0).tolist()}
    (capture / "scalp.json").write_text(json.dumps(content))
    assert words in refusal()


def test_one_photograph_only(refusal, capture):
    write_cameras(capture, read_cameras_json(capture)[:1])
    line = refusal()
    assert "only one photograph of '" in line and "needs at least two" in line


def test_one_chosen_photograph_only(refusal):
    assert "only one photograph of '" in refusal("--views", "01")


def test_an_unknown_view(refusal):
    line = refusal("--views", "00,7")
    assert "no view '7'; the capture has 00, 01, 02." in line


def test_the_capture_as_its_own_result(refusal, capture):
    line = refusal(out=capture)
    assert "is the capture itself; name another folder for the result." in line


def test_a_file_as_the_result(refusal, tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    assert "notes.txt' is a file; name a folder" in refusal(out=tmp_path / "notes.txt")


def test_a_folder_of_something_else_as_the_result(refusal, tmp_path):
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos/mine.txt").write_text("mine")
    line = refusal(out=tmp_path / "photos")
    assert "photos' is a folder that is not a result of hairfit; name another" in line


def test_something_else_in_the_place_of_the_checkpoint(refusal, tmp_path):
    (tmp_path / "result.partial").mkdir()
    (tmp_path / "result.partial/mine.txt").write_text("mine")
    line = refusal()
    assert "result.partial' is in the way of the fit's checkpoint; move it" in line


def test_a_number_of_strands_that_is_none(refusal):
    assert "--strands must be at least 1, not 0." in refusal("--strands", "0")
