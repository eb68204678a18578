"""Documents stand alone: citations, links and paths in them lead somewhere."""

import re
import shlex
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from pydantic import BaseModel
from typer._click.exceptions import ClickException

from procam.errors import ProcamError
from procam.files.venue import tables
from procam.files.venue.tables import VenueTable
from procam.interfaces.cli.main import COMMANDS, GROUPS, load_command

HERE = Path(__file__)
ROOT = HERE.parents[1]
THEORY = ROOT / "docs" / "theory"
CODE = [
    path
    for folder in (
        "procam",
        "simulators",
        "tests",
        "studies",
        "benchmarks",
        "mutations",
        "calib_data",
    )
    for path in sorted((ROOT / folder).rglob("*"))
    if path.suffix in (".py", ".c", ".h", ".frag", ".glsl", ".toml", ".md", ".html")
]
PAGES = [
    *sorted(ROOT.glob("*.md")),
    *(path for path in sorted((ROOT / "docs").rglob("*.md")) if "_build" not in path.parts),
]
TAG = re.compile(r"\b[A-Z]\d+\b")
DEFINED = re.compile(r"^    .*\S +\(([A-Z]\d+)\)", re.MULTILINE)
CITED = re.compile(r"docs/theory/([a-z-]+)\.md((?:\W{1,6}[A-Z]\d+\b)*)")
COMMAND = re.compile(r"(?:^|`)\s*(procam [a-z]+[^`\n|]*?)(?=`|\n|\s\||$)", re.MULTILINE)
LINK = re.compile(r"\]\((?!https?:|#)([^)#\s]+)(?:#[^)\s]*)?\)")
FILE = re.compile(
    r"`((?:procam|simulators|tests|studies|benchmarks|mutations|docs|calib_data)/[\w./-]+)`"
)


def defined(page: Path) -> list[str]:
    return DEFINED.findall(page.read_text("utf-8"))


EQUATIONS = {page.stem: set(defined(page)) for page in THEORY.glob("*.md")}


def citations(text: str) -> Iterator[tuple[str, list[str]]]:
    for found in CITED.finditer(text):
        yield found[1], TAG.findall(found[2])


def stale(text: str) -> list[str]:
    """Citations of pages or equations that do not exist."""
    return [
        f"docs/theory/{page}.md ({tag})" if tag else f"docs/theory/{page}.md"
        for page, tags in citations(text)
        for tag in (tags or [""])
        if page not in EQUATIONS or (tag and tag not in EQUATIONS[page])
    ]


def targets(page: Path) -> Iterator[tuple[str, Path]]:
    """What a page links to or names in backticks, and the file that must be there."""
    text = page.read_text("utf-8")
    for link in LINK.findall(text):
        yield link, page.parent / link
    for file in FILE.findall(text):
        yield file, ROOT / file


def test_each_equation_has_a_tag_of_its_own() -> None:
    tags = Counter(tag for page in THEORY.glob("*.md") for tag in defined(page))
    assert len(tags) > 40
    assert max(tags.values()) == 1, tags.most_common(3)


def test_a_stale_citation_is_found() -> None:
    assert stale("see docs/theory/geometry.md (G1)") == []
    assert stale("see docs/theory/geometry.md (G99)") == ["docs/theory/geometry.md (G99)"]
    assert stale("(docs/theory/geometry.md, G99)") == ["docs/theory/geometry.md (G99)"]
    assert stale("docs/theory/geometry.md G1, G99") == ["docs/theory/geometry.md (G99)"]
    assert stale("see docs/theory/no-such-page.md") == ["docs/theory/no-such-page.md"]


def test_citations_lead_to_an_equation() -> None:
    found = {path: stale(path.read_text("utf-8")) for path in [*CODE, *PAGES] if path != HERE}
    assert {path: cited for path, cited in found.items() if cited} == {}


def test_no_document_from_outside_is_cited() -> None:
    private = re.compile(r"\b(science|design|style|ecosystem|performance|formats)\.md\b")
    paths = (path for path in [*CODE, *PAGES] if path != HERE)
    assert [str(path) for path in paths if private.search(path.read_text("utf-8"))] == []


def test_links_and_paths_lead_to_files() -> None:
    missing = {
        (str(page.relative_to(ROOT)), target)
        for page in PAGES
        for target, path in targets(page)
        if not path.exists()
    }
    assert missing == set()


def commands(text: str) -> Iterator[list[str]]:
    """The words of each `procam COMMAND ...` in a document that names more than the command."""
    for line in COMMAND.findall(text):
        _, *words = shlex.split(line.split(" #")[0].replace("*", "a"))
        if words[0] in GROUPS:
            words[:2] = [" ".join(words[:2])]
        if len(words) > 1 and words[0] in COMMANDS:
            yield words


def test_commands_in_documents_exist() -> None:
    tops = {name.split()[0] for name in COMMANDS}
    named = [
        (page.name, found)
        for page in PAGES
        for found in re.findall(r"`procam ([a-z]+(?: [a-z]+)?)", page.read_text("utf-8"))
    ]
    wrong = [
        each
        for each in named
        if each[1].split()[0] not in tops
        or (each[1].split()[0] in GROUPS and " " in each[1] and each[1] not in COMMANDS)
    ]
    assert wrong == [] and len(named) > 80


def test_commands_in_documents_are_complete() -> None:
    """Each can be copied and run as far as its options go."""
    wrong, count = list[str](), 0
    for page in PAGES:
        for name, *arguments in commands(page.read_text("utf-8")):
            try:
                load_command(name).make_context(name, arguments)
            except ProcamError:  # there is no venue here
                pass
            except ClickException as error:
                wrong.append(f"{page.name}: procam {name}: {error.format_message()}")
            count += 1
    assert wrong == []
    assert count > 30


def test_the_code_cites_the_theory() -> None:
    cited = {page for path in CODE for page, _ in citations(path.read_text("utf-8"))}
    pages = set(EQUATIONS) - {"index"}
    assert pages <= cited, pages - cited


def test_all_keys_of_venue_toml_are_explained() -> None:
    pages = ("own-dome.md", "own-room.md")
    page = "".join((ROOT / "docs" / "howto" / name).read_text("utf-8") for name in pages)
    assert not [f"{table}.{key}" for table, key in keys_of(VenueTable) if f"`{key}`" not in page]


def keys_of(model: type[BaseModel]) -> Iterator[tuple[str, str]]:
    """Tables and keys of a model and of those in it."""
    for name, entry in model.model_fields.items():
        for inner in re.findall(r"(\w+Table)", str(entry.annotation)):
            table = getattr(tables, inner)
            yield from ((name, key) for key in table.model_fields)
