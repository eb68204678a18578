"""Text for a terminal, without what would steer it: names and messages may come from a stranger's file."""

import unicodedata

STEERING = (
    "Cc",
    "Cf",
    "Cs",
)  # control, format (also the direction of writing), halves of characters
KEPT = "\n\t"


def plain(text: str) -> str:
    r"""The text with control characters written out, but for line feeds and tabs.

    >>> print(plain("\x1b[2J south"))
    \x1b[2J south
    """
    if text.isascii() and text.isprintable():
        return text
    return "".join(_written_out(c) for c in text)


def plain_line(text: str) -> str:
    """The same as one line."""
    return plain(" ".join(text.split("\n")))


def _written_out(letter: str) -> str:
    if letter in KEPT or unicodedata.category(letter) not in STEERING:
        return letter
    return letter.encode("unicode_escape").decode()
