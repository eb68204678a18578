"""Commands of venue.toml: words and quotes, and nothing that only a shell understands."""

import pytest

from procam.files.venue.commands import command_words


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("true", ["true"]),
        ("/usr/local/bin/empty --hall 2", ["/usr/local/bin/empty", "--hall", "2"]),
        ("ask 'http://door/?a=1&b=2'", ["ask", "http://door/?a=1&b=2"]),
        ("""python -c 'print("a;b|c>$d*`e`")'""", ["python", "-c", 'print("a;b|c>$d*`e`")']),
        ('ask "a; b"', ["ask", "a; b"]),
        (r"ask \$ \; a\*", ["ask", "$", ";", "a*"]),
        ("test ! -e /run/visitors", ["test", "!", "-e", "/run/visitors"]),
        ("[ -e /run/empty ]", ["[", "-e", "/run/empty", "]"]),
        (r"ask door~1 hall#2 '~' \~ '#'", ["ask", "door~1", "hall#2", "~", "~", "#"]),
    ],
)
def test_words(text: str, words: list[str]) -> None:
    assert command_words(text) == words


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("true && false", "&&"),
        ("false || true", "||"),
        ("true & ", "&"),
        ("echo | false", "|"),
        ("echo; false", ";"),
        ("ask < door", "<"),
        ("ask >/dev/null", ">"),
        ("ask $DOOR", "$"),
        ('ask "$DOOR"', "$"),
        ('ask "`door`"', "`"),
        ("ask `door`", "`"),
        (r'ask "\$DOOR"', "$"),  # where shlex and a shell differ
        ("ask /doors/*", "*"),
        ("(true)", "("),
        ("true\nfalse", "\\n"),
        ("test ! -e ~/visitors", "~"),  # as it stands there is never such a file, and so a yes
        ("ask --file=~/visitors", "~"),
        ("test ! -e /run/visitors?", "?"),
        ("test ! -e /run/hall[12]", "["),
        ("test ! -e /run/{hall,foyer}", "{"),
        ("true # ask", "#"),
    ],
)
def test_a_shell_is_refused(text: str, found: str) -> None:
    with pytest.raises(ValueError, match="run without a shell") as refused:
        command_words(text)
    assert repr(found.replace("\\n", "\n")) in str(refused.value)


@pytest.mark.parametrize("text", ["ask 'door", 'ask "door', "ask door\\"])
def test_an_open_quote_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="left open"):
        command_words(text)


@pytest.mark.parametrize("text", ["", "  ", "''", "ask \x00", "ask \x1b"])
def test_what_is_no_command_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="all of them printable"):
        command_words(text)
