"""--json: one document on stdout, however the command ends."""

import json
import sys
from pathlib import Path

import pytest
import typer

from procam.interfaces.cli import init as init_module
from procam.interfaces.cli.main import main


def ended(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *arguments: str
) -> tuple[BaseException, str, str]:
    """How `procam ARGUMENTS` ended, stdout and stderr."""
    monkeypatch.setattr(sys, "argv", ["procam", *arguments])
    with pytest.raises(BaseException) as caught:
        main()
    out, err = capsys.readouterr()
    return caught.value, out, err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("init", "--json"), "Missing argument 'venue'"),
        (("init", "x", "--no-such-option", "--json"), "No such option: --no-such-option"),
        (("no-such-command", "--json"), "No such command 'no-such-command'"),
        (("--json",), "No such option: --json"),
        (("projector", "x", "south", "on", "too", "many", "--json"), "unexpected extra argument"),
        (
            ("compensate", "a", "b", "c", "--strength", "x", "--json"),
            "Invalid value for '--strength'",
        ),
    ],
)
def test_usage_errors(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: tuple[str, ...],
    words: str,
) -> None:
    error, out, err = ended(monkeypatch, capsys, *arguments)
    assert isinstance(error, SystemExit) and error.code == 2
    document = json.loads(out)
    assert words in document["error"] and document["exit_code"] == 2
    assert err  # people read it there as before
    _, out, _ = ended(monkeypatch, capsys, *arguments[:-1], "--no-such-option")
    assert out == ""


@pytest.mark.parametrize(
    ("raised", "words", "code"),
    [
        (ValueError("a mistake"), "ValueError: a mistake", 1),
        (RecursionError("too deep"), "RecursionError: too deep", 1),
        (MemoryError(), "MemoryError", 1),
        (typer.Abort(), "aborted", 1),
        (EOFError(), "aborted", 1),
    ],
)
def test_exceptions_that_nobody_expected(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    raised: BaseException,
    words: str,
    code: int,
) -> None:
    def fails(*_: object) -> None:
        raise raised

    monkeypatch.setattr(init_module, "create_venue", fails)
    arguments = ("init", str(tmp_path / "new"), "--template", "by-hand")
    error, out, _ = ended(monkeypatch, capsys, *arguments, "--json")
    document = json.loads(out)
    assert words in document["error"] and document["exit_code"] == code
    assert error is raised or getattr(error, "code", None) == code
    assert ended(monkeypatch, capsys, *arguments)[1] == ""


def test_a_command_that_ends_well_prints_one_document(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    template = ("--template", "by-hand")
    error, out, _ = ended(monkeypatch, capsys, "init", str(tmp_path / "a"), *template, "--json")
    assert isinstance(error, SystemExit) and not error.code
    assert "error" not in json.loads(out)
