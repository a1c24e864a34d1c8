import json

import numpy as np
import pytest
import trimesh
from known_hair import front_camera, moved, parallel

from hairfit.capture.capture import View
from hairfit.errors import InputError
from hairfit.evaluate import evaluate
from hairfit.types import Mesh, Strands


@pytest.fixture(scope="module")
def ball():
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=0.04)
    return Mesh(np.asarray(mesh.vertices), np.asarray(mesh.faces, np.int64))


@pytest.fixture(scope="module")
def tuft(ball):
    """Strands that stand out from a ball, half of them on the far side."""
    ways = ball.vertices[::3] / 0.04
    return Strands.from_array(ways[:, None] * np.linspace(0.041, 0.08, 6)[:, None])


@pytest.fixture(scope="module")
def view():
    rng = np.random.default_rng(0)
    image = rng.uniform(0.2, 0.8, (96, 96, 3)).astype(np.float32)
    return View("front", front_camera(), image, np.ones((96, 96), bool))


def test_the_truth_against_itself_is_perfect(tuft, ball, view):
    found = evaluate(tuft, tuft, head=ball, views=[view])
    assert found.visible is not None and found.interior is not None
    for result in (*found.every, *found.visible, *found.interior):
        assert result.unsigned == (1.0, 1.0, 1.0) and result.signed == (1.0, 1.0, 1.0)
    assert found.consistency == (1.0, 1.0, 1.0)
    assert found.shape.length == 0.0 and found.shape.curvature == 0.0
    assert found.head is not None and found.head.rooted == 1.0
    assert found.head.deep == 0 and found.head.share_inside == 0.0


def test_what_faces_the_camera_is_scored_apart(tuft, ball, view):
    points = tuft.points.reshape(tuft.count, -1, 3)
    front = points[points[:, 0, 2] > -0.02]  # a camera on +z sees beyond the rim
    found = evaluate(Strands.from_array(front), tuft, head=ball, views=[view])
    assert found.visible is not None and found.interior is not None
    assert found.visible[0].unsigned.recall > 0.95
    assert found.interior[0].unsigned.recall < 0.6
    assert found.every[0].unsigned.precision == 1.0


def test_all_figures_are_ready_for_json(tuft, ball, view):
    figures = evaluate(tuft, tuft, head=ball, views=[view]).to_dict()
    assert json.loads(json.dumps(figures, allow_nan=False)) == figures
    assert figures["all"]["3mm_30deg"]["unsigned"]["f"] == 1.0
    assert figures["interior"]["2mm_20deg"]["signed"]["recall"] == 1.0
    assert figures["consistency"]["4mm_40deg"] == 1.0
    assert figures["head"]["points_deeper_than_1mm"] == 0
    assert set(figures["photographs"]["front"]) == {
        "mean_angle_deg",
        "median_angle_deg",
        "hair_iou",
        "covered_iou",
    }


def test_without_a_capture_the_rest_is_measured():
    hair = parallel()
    found = evaluate(moved(hair, [2.5e-3, 0, 0]), hair, head=None, views=None)
    figures = found.to_dict()
    assert [figures[part] for part in ("visible", "interior", "head")] == [None] * 3
    assert figures["photographs"] is None
    assert figures["all"]["2mm_20deg"]["unsigned"]["f"] == 0.0
    assert figures["all"]["3mm_30deg"]["unsigned"]["f"] == 1.0


def test_the_table_has_a_row_for_every_score(tuft, ball, view):
    found = evaluate(tuft, tuft, head=ball, views=[view])
    rows = found.table()
    assert rows[0] == ("", "precision", "recall", "F", "F signed")
    assert ("within, 3 mm, 30°", *["100.0 %"] * 4) in rows
    assert ("strand consistency", "100.0 100.0 100.0 %") in rows
    assert rows[-1][0] == "photograph front"


def test_no_hair_is_refused():
    none = Strands(np.zeros((0, 3)), np.array([0]))
    with pytest.raises(InputError, match="the recovered strands hold no strand"):
        evaluate(none, parallel(), head=None, views=None)
