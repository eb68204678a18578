"""Commands in venue.toml: words and quotes as in a shell, and whatever else a shell has is refused."""

import re
import shlex

QUOTED = re.compile(r"\\.|'[^']*'|\"(?:\\.|[^\"\\])*\"", re.DOTALL)
# "[" alone is a program; "~" and "#" are the shell's at the beginning of a word only
OF_A_SHELL = re.compile(r"&&|\|\||[&|;<>$`*?{}()\n]|(?<![^\s=:])~|(?<!\S)#|\[(?=\S)|(?<=\S)\[")
PART = "_"  # stands for a quoted part that a shell leaves as it is
EXPANDED = re.compile(r"[$`]")  # between double quotes
SCRIPT = "write a script and give its path"


def command_words(text: str) -> list[str]:
    """The words of a command, which is run without a shell.

    Raises
    ------
    ValueError
        It has no words, an open quote, a control character, or what only a shell would understand outside
        single quotes: `&`, `|`, `;`, `<`, `>`, `$`, a backtick, `*`, `?`, a bracket, or a word that begins
        with `~` or `#`. As a plain letter it would turn the question of an interlock into another one.
    """
    found = OF_A_SHELL.search(QUOTED.sub(_expanded, text))
    if found:
        raise ValueError(
            f"a program with its arguments, which is run without a shell, so {found[0]!r} means nothing: "
            f"{SCRIPT}, or put it between single quotes if it is meant as it stands"
        )
    try:
        words = shlex.split(text)
    except ValueError:
        raise ValueError(
            f"a program with its arguments, and a quote or backslash is left open: close it, or {SCRIPT}"
        ) from None
    if not words or not words[0] or not text.isprintable():
        raise ValueError(f"a program with its arguments, all of them printable: {SCRIPT}")
    return words


def _expanded(quoted: re.Match[str]) -> str:
    """What a shell would expand of a quoted part."""
    found = EXPANDED.search(quoted[0]) if quoted[0].startswith('"') else None
    return found[0] if found else PART
