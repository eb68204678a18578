"""`python -m studies.preference`: which of two compensation methods people prefer.

`ask` writes a page that shows pairs of pictures, `answers` analyses what people answered there.
"""

import typer

from procam.interfaces.cli.main import SETTINGS, main
from studies.preference.ask import ask
from studies.preference.results import answers

app = typer.Typer(
    name="preference",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings=SETTINGS,
)
for command in (ask, answers):
    app.command(context_settings=SETTINGS)(command)

if __name__ == "__main__":
    main(app)
