from hairfit.report.progress import TimeLeft, shown_progress, spoken


def test_the_time_left_counts_what_was_done_just_now():
    times = iter([0.0, 10.0, 20.0])
    left = TimeLeft(lambda: next(times))
    assert left(0.5) is None  # a fit that resumes half way
    assert left(0.6) == 10.0 * 0.4 / (0.6 - 0.5)
    assert left(1.0) == 0.0


def test_times_are_said_as_people_say_them():
    assert spoken(None) == spoken(0.0) == ""
    assert spoken(12.3) == "about 12 s left"
    assert spoken(200.0) == "about 3 min left"


def test_without_a_terminal_each_stage_is_a_line(capsys):
    with shown_progress(quiet=False) as progress:
        for share in (0.0, 0.1, 0.2):
            progress("looking", share)
        progress("growing", 0.5)
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "  0 %  looking"
    assert len(lines) == 2 and lines[1].startswith(" 50 %  growing")


def test_quiet_is_quiet(capsys):
    with shown_progress(quiet=True) as progress:
        progress("looking", 0.5)
    assert capsys.readouterr().err == ""
