"""`python -m studies`, and that every committed result has a name there that remakes it."""

from pathlib import Path

import pytest

from studies.__main__ import STUDIES, listed, main

HERE = Path(__file__).parents[2] / "studies"


@pytest.mark.parametrize("result", sorted(HERE.glob("*.json")), ids=lambda path: path.stem)
def test_each_result_can_be_remade(result: Path) -> None:
    assert result.stem.replace("_", "-") in STUDIES


def test_each_study_is_listed_with_what_it_is_about(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines == list(listed()) and [line.split()[0] for line in lines] == sorted(STUDIES)
    assert all(len(line.split()) > 5 for line in lines)


def test_a_study_that_fails_ends_with_1(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(STUDIES, "speed", lambda: 1)
    monkeypatch.setitem(STUDIES, "codes", lambda: None)
    assert (main(["codes"]), main(["speed", "codes"])) == (0, 1)


def test_one_that_raises_does_not_end_the_others(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    done = list[str]()
    monkeypatch.setitem(STUDIES, "speed", lambda: 1 / 0)
    monkeypatch.setitem(STUDIES, "codes", lambda: done.append("codes"))
    assert main(["speed", "codes"]) == 1
    assert done == ["codes"] and "ZeroDivisionError" in capsys.readouterr().err


def test_a_name_that_is_none(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["no-such-study"]) == 2
    assert "no study 'no-such-study'; there are boards," in capsys.readouterr().err
