import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from tiny_capture import look_at_head

from hairfit.capture import choose_views, select
from hairfit.capture.select import closeness, spread
from hairfit.errors import InputError
from hairfit.render.camera import Camera


@dataclasses.dataclass(frozen=True)
class Named:
    name: str
    camera: Camera


def ring(count):
    views = []
    for k in range(count):
        pose = jnp.asarray(look_at_head(2 * np.pi * k / count))
        views.append(Named(f"{k:02}", Camera(jnp.eye(3), pose, 4, 4)))
    return views


def test_names_are_taken_with_and_without_suffix_in_the_captures_order():
    assert choose_views("04.png, 00,02", ring(8)) == ("00", "02", "04")
    assert choose_views("03", ring(8)) == ("03",)


def test_four_of_a_ring_of_eight_are_every_other():
    assert choose_views("4", ring(8)) == ("00", "02", "04", "06")


def test_three_of_a_ring_of_nine_are_every_third():
    assert choose_views("3", ring(9)) == ("00", "03", "06")


def test_the_front_most_is_always_chosen():
    views = ring(8)[3:] + ring(8)[:3]
    for count in range(1, 9):
        chosen = choose_views(str(count), views)
        assert "00" in chosen and len(chosen) == count


def test_exchanges_come_close_to_the_best_of_all_choices(monkeypatch):
    rng = np.random.default_rng(0)
    towards = rng.normal(size=(12, 3))
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    apart = np.arccos(np.clip(towards @ towards.T, -1, 1))

    def least(chosen):
        return closeness(apart, chosen)[0]

    best = spread(towards, 5)
    monkeypatch.setattr(select, "MOST_CHOICES", 0)
    assert least(spread(towards, 5)) >= 0.8 * least(best)


def test_unknown_names_are_refused_with_the_known():
    with pytest.raises(InputError, match="no view '9x'; the capture has 00, 01, 02."):
        choose_views("00,9x", ring(3))


def test_more_views_than_there_are_are_refused():
    with pytest.raises(InputError, match="asks for 5 views, but the capture has 3"):
        choose_views("5", ring(3))
