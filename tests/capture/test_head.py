import numpy as np
import pytest
import trimesh
from tiny_capture import camera_entry

from hairfit.capture.cameras import common_point, parse_entry
from hairfit.capture.head import load_head
from hairfit.errors import InputError


@pytest.fixture
def entries(tmp_path):
    angles = np.radians([0, 120, 240])
    return [
        parse_entry(camera_entry(f"{k:02}", a), tmp_path) for k, a in enumerate(angles)
    ]


@pytest.fixture
def ball():
    return trimesh.creation.icosphere(subdivisions=3, radius=0.1)


def load(mesh, path, entries):
    mesh.export(path)
    return load_head(path, entries)


def volume(mesh):
    return trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).volume


def test_an_open_neck_is_handled(tmp_path, entries, ball):
    ball.update_faces(ball.triangles_center[:, 1] > -0.07)
    head = load(ball, tmp_path / "head.obj", entries)
    assert len(head.faces) == len(ball.faces)


def test_faces_that_look_inwards_are_turned(tmp_path, entries, ball):
    ball.invert()
    assert ball.volume < 0
    assert volume(load(ball, tmp_path / "head.obj", entries)) > 0


def test_a_head_with_shoulders_is_in_metres(tmp_path, entries, ball):
    shoulders = trimesh.creation.box((0.7, 0.2, 0.2))
    shoulders.apply_translation([0, -0.3, 0])
    both = trimesh.util.concatenate([ball, shoulders])
    head = load(both, tmp_path / "head.obj", entries)
    assert np.isclose(np.ptp(head.vertices[:, 0]), 0.7, atol=1e-6)


def test_a_head_far_from_the_origin_loads(tmp_path, ball):
    shift = np.array([3.0, -2.0, 5.0])
    entries = []
    for k, azimuth in enumerate(np.radians([0, 120, 240])):
        entry = camera_entry(f"{k:02}", azimuth)
        pose = np.array(entry["cam_from_world"])
        pose[:3, 3] -= pose[:3, :3] @ shift
        entry["cam_from_world"] = pose.tolist()
        entries.append(parse_entry(entry, tmp_path))
    found = common_point(entries)
    assert found is not None and np.allclose(found, shift, atol=1e-9)
    ball.apply_translation(shift)
    assert len(load(ball, tmp_path / "head.obj", entries).faces) == len(ball.faces)


def test_one_camera_alone_does_not_fix_a_point(entries):
    assert common_point(entries[:1]) is None
    assert common_point([entries[0], entries[0]]) is None


def test_a_head_in_millimetres_is_seen_with_one_camera_too(tmp_path, entries, ball):
    ball.apply_scale(1000)
    with pytest.raises(InputError, match="is 200 wide, which is not in metres"):
        load(ball, tmp_path / "head.obj", entries[:1])
