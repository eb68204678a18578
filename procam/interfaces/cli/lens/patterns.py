"""`procam lens patterns`: the pictures of one structured-light code."""

from pathlib import Path
from typing import Annotated

import typer

from procam.estimate.structured_light.codes import DEFAULT_CODE, picture
from procam.estimate.structured_light.described import folder_order
from procam.files.atomic import replacing_directory
from procam.files.images.pixels import write_image
from procam.interfaces.cli._codes import chosen_code
from procam.interfaces.cli._options import CodeOption, Json, SizeOption
from procam.interfaces.cli._output import Output
from procam.interfaces.cli._paths import check_new_folder, panel_size

EXAMPLE = "procam lens patterns pictures --size 1280x800"


def patterns(
    out: Annotated[Path, typer.Argument(metavar="OUT", help="New folder for the pictures.")],
    *,
    size: SizeOption,
    code: CodeOption = DEFAULT_CODE,
    json: Json = False,
) -> None:
    """Write the pictures of a code, for `procam decode` and `procam lens pair`.

    They are in the order that these need.
    """
    layout = chosen_code(code, panel_size(size))
    check_new_folder(out)
    output, order = Output(json), folder_order(layout)
    with replacing_directory(out) as folder:
        for number, plane in enumerate(order):
            write_image(folder / f"{number:04d}.png", picture(layout, layout.planes[plane]))
    output.say(
        f"{len(order)} pictures written to {out}; show them in the order of their names, photograph each, "
        f"and decode with --code {code}"
    )
    output.finish({"out": str(out), "pictures": [str(layout.planes[i]) for i in order]})
