"""The code that `--code` and `--order` name, and the answer to a wrong number of pictures."""

from dataclasses import replace
from pathlib import Path

from procam.estimate.structured_light.codes import CODES, Code, make_code
from procam.estimate.structured_light.described import described_code, folder_order
from procam.files.code_file import load_code
from procam.interfaces.cli._paths import Size


def chosen_code(text: str, size: Size, order: str = "") -> Code:
    """The code of a name or of a TOML file that describes it, in the order of its pictures."""
    if text.endswith(".toml"):
        code = described_code(load_code(Path(text)), size)
    else:
        code = make_code(text, size)
    blocks = tuple(block.strip() for block in order.split(",") if block.strip())
    code = replace(code, blocks=blocks) if blocks else code
    folder_order(code)  # refuses an order that does not name every pattern once
    return code


def count_refusal(folder: Path, count: int, code: Code) -> str:
    """Which numbers of pictures would fit, and how to describe a code that procam does not know."""
    width, height = code.size
    each = ", ".join(f"{name} {len(make_code(name, code.size).planes)}" for name in CODES)
    return (
        f"{folder}: there are {count} pictures, and the code {code.name} of a projector of "
        f"{width}x{height} needs {len(code.planes)} (of procam's own codes there: {each}). If another "
        "program drew the patterns, describe its code in a TOML file and give that with --code "
        "(docs/howto/foreign-codes.md)"
    )
