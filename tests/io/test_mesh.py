import hypothesis
import numpy as np
import pytest
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from hairfit.errors import InputError
from hairfit.io.mesh import load_mesh, save_mesh
from hairfit.types import Mesh


@st.composite
def meshes(draw):
    count = draw(st.integers(3, 12))
    place = st.floats(-5, 5, width=32)
    vertices = draw(hnp.arrays(np.float32, (count, 3), elements=place))
    index = st.integers(0, count - 1)
    rows = draw(st.integers(1, 8))
    return Mesh(vertices, draw(hnp.arrays(np.int64, (rows, 3), elements=index)))


@pytest.mark.parametrize("suffix", [".obj", ".ply"])
@hypothesis.given(mesh=meshes())
@hypothesis.settings(max_examples=25, deadline=None)
def test_a_mesh_comes_back_as_it_was_saved(tmp_path_factory, suffix, mesh):
    path = tmp_path_factory.mktemp("mesh") / f"head{suffix}"
    save_mesh(path, mesh)
    again = load_mesh(path)
    assert np.array_equal(again.vertices.astype(np.float32), mesh.vertices)
    assert np.array_equal(again.faces, mesh.faces)


def load_text(folder, text, name="head.obj"):
    (folder / name).write_text(text)
    return load_mesh(folder / name)


SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


def test_a_quad_becomes_two_triangles(tmp_path):
    mesh = load_text(tmp_path, SQUARE + "f 1 2 3 4\n")
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    ply = (
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
        "property float z\nelement face 1\nproperty list uchar int vertex_indices\n"
        "end_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n"
    )
    mesh = load_text(tmp_path, ply, "head.ply")
    assert len(mesh.faces) == 2 and set(mesh.faces.ravel()) == {0, 1, 2, 3}


def test_indices_may_count_back_and_name_textures(tmp_path):
    mesh = load_text(
        tmp_path, "# a head\no head\nvt 0 0\n" + SQUARE + "f -4/1 -3/1/1 \\\n -2//1\n"
    )
    assert mesh.faces.tolist() == [[0, 1, 2]]


def test_texture_seams_do_not_open_the_surface(tmp_path):
    textures = "vt 0 0\nvt 1 1\n"
    mesh = load_text(tmp_path, SQUARE + textures + "f 1/1 2/1 3/1\nf 1/2 3/2 4/2\n")
    assert len(mesh.vertices) == 4


def test_colours_of_vertices_are_passed_over(tmp_path):
    text = "v 0 0 0 1 0 0\nv 1 0 0 1 1 1\nv 0 1 0 0 0 0\nf 1 2 3\n"
    assert load_text(tmp_path, text).vertices.shape == (3, 3)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "has no face"),
        (SQUARE, "has no face"),
        (SQUARE + "f 1 2 9\n", r"a vertex that is not there \(it has 4\)"),
        (SQUARE + "f 1 2 -9\n", "is damaged in line 5"),
        (SQUARE + "f 1 2 0\n", "a vertex that is not there"),
        (SQUARE + "f 1 2\n", "is damaged in line 5"),
        ("v 0 a 0\n", "is damaged in line 1"),
        ("v 0 0\n", "is damaged in line 1"),
        ("v nan 0 0\n" + SQUARE + "f 1 2 3\n", "not finite numbers"),
    ],
)
def test_a_damaged_obj_is_refused(tmp_path, text, message):
    with pytest.raises(InputError, match=message):
        load_text(tmp_path, text)


@pytest.mark.parametrize("text", ["", "hello", "ply\nformat ascii 1.0\n"])
def test_a_damaged_ply_is_refused(tmp_path, text):
    with pytest.raises(InputError, match="is damaged or no PLY file; export it again"):
        load_text(tmp_path, text, "head.ply")


def test_what_is_no_mesh_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"is not a mesh; give an \.obj or a \.ply"):
        load_mesh(tmp_path / "head.fbx")
    with pytest.raises(InputError, match=r"there is no mesh '.*head\.obj'"):
        load_mesh(tmp_path / "head.obj")
    triangle = Mesh(np.eye(3), np.array([[0, 1, 2]]))
    with pytest.raises(InputError, match=r"saved as \.obj or \.ply, not as 'a\.fbx'"):
        save_mesh(tmp_path / "a.fbx", triangle)
