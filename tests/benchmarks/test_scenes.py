import dataclasses

import pytest
import scenes
from scenes import SCENES, make_scene

from hairfit.errors import InputError
from hairfit.synthetic import STYLES
from hairfit.synthetic.gallery import GALLERY


def test_scenes_are_of_many_styles_lights_colours_and_sizes():
    recipes = list(SCENES.values())
    assert len(recipes) >= 10
    assert len({one.style for one in recipes}) == len(recipes)
    for part, least in (("hair", 6), ("light", 5), ("size", 4), ("noise", 4)):
        assert len({repr(getattr(one, part)) for one in recipes}) >= least
    assert {one.scene().views for one in recipes} == {12}
    known = {*STYLES, *(f"gallery:{name}" for name in GALLERY)}
    assert {one.style for one in recipes} <= known
    brightness = [max(one.hair) for one in recipes]
    assert max(brightness) > 20 * min(brightness)


def test_a_scene_is_made_once_and_anew_for_another_recipe(tmp_path, monkeypatch):
    made = []

    def write(tree, head, folder, scene):
        folder.mkdir()
        made.append((folder, scene.look.hair))

    monkeypatch.setattr(scenes, "write_capture", write)
    monkeypatch.setattr(scenes.Recipe, "tree", lambda recipe: None)
    folder = make_scene("straight", tmp_path)
    assert folder.name == "straight" and make_scene("straight", tmp_path) == folder
    assert made == [(folder, scenes.BLACK)]
    blond = dataclasses.replace(SCENES["straight"], hair=scenes.BLOND)
    monkeypatch.setitem(scenes.SCENES, "straight", blond)
    other = make_scene("straight", tmp_path)
    assert other != folder and other.name == "straight"
    assert made == [(folder, scenes.BLACK), (other, scenes.BLOND)]


def test_an_unknown_scene_is_refused(tmp_path):
    with pytest.raises(InputError, match="no scene 'perm'; take one of straight, "):
        make_scene("perm", tmp_path)
