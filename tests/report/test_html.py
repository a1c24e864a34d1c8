import re

import numpy as np

from hairfit.report.html import ViewPage, flat, report_html


def page(name, size=(40, 30), seed=0):
    picture = np.random.default_rng(seed).integers(0, 255, (*size, 3), np.uint8)
    return ViewPage(name, picture, picture, picture, {"angle error": "7.1 degrees"})


def test_a_report_shows_every_view_and_needs_no_network():
    frames = [page("frame").photo] * 3
    text = report_html("anna & co", [page("00"), page("01")], {"F": 0.5}, frames)
    assert text.count("<section class='view'>") == 2
    assert text.count("data:image/jpeg;base64,") == 2 * 3 + 3
    assert "anna &amp; co" in text and "angle error 7.1 degrees" in text
    assert not re.search(r"https?:|src='(?!data:)|href=", text)


def test_a_report_without_a_turntable_has_no_slider():
    assert "type='range'" not in report_html("anna", [page("00")], {}, [])


def test_how_sure_the_fit_is_is_shown_with_what_its_colours_mean():
    sides = [page("side").photo] * 4
    text = report_html("anna", [page("00")], {}, [], certainty=sides)
    assert text.count("data:image/jpeg;base64,") == 3 + 4
    assert text.index("How sure the fit is") < text.index("blue is sure")
    assert text.index("red is a guess") < text.index("<section class='sides'>")
    assert "How sure" not in report_html("anna", [page("00")], {}, [])


def test_a_large_report_is_reduced_to_six_megabytes():
    pages = [page(str(k), (480, 480), k) for k in range(12)]
    assert len(report_html("anna", pages, {}, [])) < 6_000_000


def test_nested_figures_become_one_level():
    figures = {"all": {"f_2mm": 0.12345678, "views": ["a", 1.5]}, "n": 3, "x": None}
    expected = {"all / f 2mm": "0.1235", "all / views": "a, 1.5"}
    assert flat(figures) == expected | {"n": "3", "x": "unknown"}


def test_doubts_about_photographs_are_sentences_at_the_top():
    doubt = "the hair mask of photograph '<03>' is wrong."
    text = report_html("anna", [page("00")], {}, [], [doubt])
    sentence = "<li>The hair mask of photograph &#x27;&lt;03&gt;&#x27; is wrong.</li>"
    assert text.index("Doubtful photographs") < text.index(sentence)
    assert text.index(sentence) < text.index("<h2>Figures")
    assert "Doubtful" not in report_html("anna", [page("00")], {}, [])
