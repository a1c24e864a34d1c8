import dataclasses
import hashlib
import importlib.util
import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from hairfit import InputError
from hairfit.io.mesh import load_mesh
from hairfit.io.tree import load_tree
from hairfit.render import project_points
from hairfit.synthetic import Scene, make_head, make_scalp, make_style, write_capture
from hairfit.synthetic import scene as scene_module
from hairfit.synthetic.picture import make_lighting
from hairfit.synthetic.png import save_png
from hairfit.synthetic.scene import photograph, scene_cameras, scene_strands

ROOT = Path(__file__).resolve().parents[2]
SMALL = Scene(views=3, size=(48, 64), strands=300, points=20)


@pytest.fixture(scope="module")
def head():
    return make_head()


@pytest.fixture(scope="module")
def tree(head):
    return make_style("wavy", 0, make_scalp(head))


@pytest.fixture(scope="module")
def capture(head, tree, tmp_path_factory):
    folder = tmp_path_factory.mktemp("synth") / "capture"
    write_capture(tree, head, folder, SMALL)
    return folder


def script():
    path = ROOT / "scripts" / "make_synthetic.py"
    spec = importlib.util.spec_from_file_location("make_synthetic", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def read(path) -> np.ndarray:
    found = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert found is not None
    return np.asarray(found)


def test_a_capture_holds_what_the_design_says(capture, head, tree):
    views = json.loads((capture / "cameras.json").read_text())["views"]
    assert [view["name"] for view in views] == ["00.png", "01.png", "02.png"]
    for view in views:
        image = read(capture / "images" / view["name"])
        assert image.shape == (64, 48, 3) and image.dtype == np.uint8
        hair = read(capture / "masks" / "hair" / view["name"])
        body = read(capture / "masks" / "body" / view["name"])
        assert set(np.unique(hair)) == set(np.unique(body)) == {0, 255}
        assert not (hair & body).any()
    assert np.allclose(load_mesh(capture / "head.obj").vertices, head.vertices)
    loaded = load_tree(capture / "tree.hairtree")
    assert np.array_equal(loaded.cylinder.skeleton, tree.cylinder.skeleton)
    truth = np.load(capture / "truth.npz")
    assert truth["points"].shape == (300 * 20, 3)
    assert truth["offsets"].tolist() == list(range(0, 6001, 20))


def test_the_checksums_are_those_of_the_files(capture):
    lines = (capture / "SHA256SUMS").read_text().splitlines()
    assert len(lines) == 3 * 3 + 4
    for line in lines:
        expected, name = line.split("  ")
        assert hashlib.sha256((capture / name).read_bytes()).hexdigest() == expected


def test_the_first_camera_stands_before_the_face_and_hair_fills_the_picture(tree):
    scene = dataclasses.replace(SMALL, views=10, size=(384, 512))
    points = scene_strands(tree, scene)
    cameras = scene_cameras(points, scene)
    views = np.array([camera.cam_from_world for camera in cameras])
    eyes = -np.einsum("nji,nj->ni", views[:, :3, :3], views[:, :3, 3])
    assert eyes[0, 2] > 1.0 and abs(eyes[0, 0]) < 0.01
    assert eyes[2, 0] > 1.0  # going round by the person's left
    low, high = points.min((0, 1)), points.max((0, 1))
    away = np.linalg.norm(eyes - 0.5 * (low + high), axis=1)
    assert np.allclose(away, 1.1, atol=1e-3)
    assert (eyes[8:, 1] > 0.6).all() and (eyes[:8, 1] < 0.3).all()
    pixel = project_points(points, cameras[0]).pixel
    tall = np.ptp(pixel[..., 1]) / 512
    assert tall == pytest.approx(0.62, abs=0.08)
    for camera in cameras:
        inside = project_points(points, camera).pixel
        assert inside.min() > 0 and (inside < [384, 512]).all()


def test_a_folder_that_holds_something_is_left_alone(tree, head, tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(InputError, match="is not empty; name a folder that does not"):
        write_capture(tree, head, tmp_path, SMALL)
    assert [p.name for p in tmp_path.iterdir()] == ["mine.txt"]


def test_what_is_interrupted_leaves_nothing(tree, head, tmp_path, monkeypatch):
    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(scene_module, "write_cameras", interrupt)
    with pytest.raises(KeyboardInterrupt):
        write_capture(tree, head, tmp_path / "capture", SMALL)
    assert list(tmp_path.iterdir()) == []


def test_the_scene_of_the_repository_comes_out_again(head, tree):
    made = script()
    kept, scene = made.DATA / "wavy", made.SCENES["wavy"]
    assert made.SEED == 0  # as the tree of this file
    points = scene_strands(tree, scene)
    truth = np.load(kept / "truth.npz")["points"]
    assert truth.tobytes() == points.astype(np.float32).tobytes()
    camera = scene_cameras(points, scene)[3]
    lighting = make_lighting(points, scene.look)
    picture = photograph(points, head, camera, lighting, scene, 3)
    # XLA fuses multiplications and additions by what the processor has, so the last
    # bit of a pixel differs between kinds of them: seen in 4 of 10,000 values.
    stored = read(kept / "images" / "03.png")[..., ::-1].astype(int)
    off = np.abs(stored - picture.image)
    assert off.max() <= 1 and (off > 0).mean() < 1e-3
    assert np.array_equal(read(kept / "masks" / "hair" / "03.png") > 0, picture.hair)
    assert np.array_equal(read(kept / "masks" / "body" / "03.png") > 0, picture.body)


@pytest.mark.parametrize("shape", [(5, 7), (5, 7, 3)])
def test_pictures_are_read_back_as_they_were_written(shape, tmp_path):
    picture = np.random.default_rng(0).integers(0, 256, shape, np.uint8)
    save_png(tmp_path / "a.png", picture)
    found = read(tmp_path / "a.png")
    assert np.array_equal(found if len(shape) == 2 else found[..., ::-1], picture)
