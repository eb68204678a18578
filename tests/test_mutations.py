"""The list of mutations fits the source, and a mutation is judged by its tests."""

from collections import Counter
from pathlib import Path

import pytest

from mutations.__main__ import is_chosen, table
from mutations.definitions import PACKAGES, read_definitions
from mutations.mutant import Broken, Mutation, Outcome, read_mutations, tried

ROOT = Path(__file__).parents[1]
EVERY = read_mutations(ROOT / "mutations" / "list.toml")
DEFINITIONS = read_definitions(ROOT)
SOURCE = """\
LIMIT = 2  # not half of it


class Number:
    @staticmethod
    def half(x):
        return x / 2  # of x


def half(x):
    return Number.half(x)
"""
HALF = Mutation("half is a third", "Number.half", "2", "3", ("test_code.py",))


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A tree with one module and one test."""
    package = tmp_path / PACKAGES[0]
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "code.py").write_text(SOURCE, "utf-8")
    (tmp_path / "test_code.py").write_text(
        f"from {PACKAGES[0]}.code import half\n\ndef test_half():\n    assert half(4) == 2\n",
        "utf-8",
    )
    return tmp_path


@pytest.mark.parametrize("mutation", EVERY, ids=lambda m: m.name)
def test_the_mistake_can_be_made(mutation: Mutation) -> None:
    mutation.find(DEFINITIONS)
    assert mutation.new != mutation.old
    assert all((ROOT / test.split("::")[0]).is_file() for test in mutation.tests)


def test_names_are_unique_and_say_what_is_wrong() -> None:
    assert Counter(m.name for m in EVERY).most_common(1)[0][1] == 1
    assert len(EVERY) >= 60
    parts = {"maths", "estimate", "compensate", "files", "kernels"}
    assert {m.find(DEFINITIONS).path.relative_to(ROOT).parts[1] for m in EVERY} >= parts


def test_a_mistake_that_a_test_notices_is_killed(tree: Path) -> None:
    outcome = tried(HALF, tree)
    assert outcome.killed and outcome.killer == "test_code.py::test_half"
    assert (tree / PACKAGES[0] / "code.py").read_text(
        "utf-8"
    ) == SOURCE  # the tree itself is untouched


def test_one_that_no_test_notices_survives(tree: Path) -> None:
    comment = Mutation("of y", "Number.half", "of x", "of y", ("test_code.py",))
    assert not tried(comment, tree).killed


def test_a_definition_may_move(tree: Path) -> None:
    code = tree / PACKAGES[0] / "code.py"
    number = SOURCE[SOURCE.index("class Number") : SOURCE.index("\n\ndef half")]
    code.with_name("other.py").write_text(number, "utf-8")
    code.write_text("from .other import Number\n" + SOURCE.replace(number, ""), "utf-8")
    assert tried(HALF, tree).killed


def test_only_the_definition_changes(tree: Path) -> None:
    HALF.find(read_definitions(tree)).replace(HALF.old, HALF.new)
    text = (tree / PACKAGES[0] / "code.py").read_text("utf-8")
    assert text == SOURCE.replace("x / 2", "x / 3")


def test_a_module_chooses_between_definitions_with_the_same_text(tree: Path) -> None:
    (tree / PACKAGES[0] / "other.py").write_text("LIMIT = 2\n", "utf-8")
    definitions = read_definitions(tree)
    with pytest.raises(Broken, match=r"a: LIMIT holds '2' 2 times, not once"):
        Mutation("a", "LIMIT", "2", "3", ()).find(definitions)
    assert Mutation("a", "other:LIMIT", "2", "3", ()).find(definitions).path.name == "other.py"
    assert Mutation("a", "LIMIT", "not", "no", ()).find(definitions).path.name == "code.py"


def test_a_header_of_c_is_one_definition(tree: Path) -> None:
    (tree / PACKAGES[0] / "half.h").write_text("#define HALF 0.5f\n", "utf-8")
    assert Mutation("a", "half.h", "0.5f", "0.4f", ()).find(read_definitions(tree)).is_c


@pytest.mark.parametrize("word", ["third", "Number", "test_code"])
def test_words_choose_by_name_definition_and_tests(word: str) -> None:
    assert is_chosen(HALF, []) and is_chosen(HALF, ["fourth", word])
    assert not is_chosen(HALF, ["fourth"])


@pytest.mark.parametrize(
    ("definition", "old", "message"),
    [
        (
            "Number.half",
            "x",
            r"half: Number\.half holds 'x' 3 times, not once; correct mutations/list\.toml",
        ),
        ("third", "x", r"half: nothing is named third; correct mutations/list\.toml"),
        ("half", "def half", r"half: the tests do not run: .*ERROR test_code"),
    ],
)
def test_a_run_that_means_nothing_is_refused(
    tree: Path, definition: str, old: str, message: str
) -> None:
    with pytest.raises(Broken, match=f"(?s){message}"):
        tried(Mutation("half", definition, old, "def third", ("test_code.py",)), tree)


def test_survivors_stand_first_with_their_argument() -> None:
    argued = Mutation("a", "f", "1", "2", (), "nobody sees it")
    bare, killed = Mutation("b", "g", "1", "2", ()), Mutation("c", "h", "1", "2", ())
    outcomes = [
        Outcome(killed, "test_c.py::test", 1.0),
        Outcome(argued, "", 1.0),
        Outcome(bare, "", 1.0),
    ]
    text = "\n".join(table(outcomes))
    assert "1 of 3 small mistakes are killed" in text
    rows = [line for line in text.splitlines() if line.startswith(("| a", "| b", "| c"))]
    assert rows == [
        "| a | f | nobody sees it |",
        "| b | g | no argument: it needs a test |",
        "| c | h | test_c.py::test |",
    ]
