"""The list of mutations fits the source, and a mutation is judged by its tests."""

from collections import Counter
from pathlib import Path

import pytest

from mutations.__main__ import table
from mutations.mutant import Broken, Mutation, Outcome, read_mutations, tried

ROOT = Path(__file__).parents[1]
EVERY = read_mutations(ROOT / "mutations" / "list.toml")
HALF = Mutation("half is a third", "half_code.py", "2", "3", ("test_code.py",))


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A tree with one file and one test."""
    (tmp_path / "half_code.py").write_text("def half(x):\n    return x / 2  # of x\n", "utf-8")
    (tmp_path / "test_code.py").write_text(
        "from half_code import half\n\ndef test_half():\n    assert half(4) == 2\n", "utf-8"
    )
    return tmp_path


@pytest.mark.parametrize("mutation", EVERY, ids=lambda m: m.name)
def test_the_mistake_can_be_made(mutation: Mutation) -> None:
    text = (ROOT / mutation.file).read_text("utf-8")
    assert text.count(mutation.old) == 1, f"correct its old text in mutations/list.toml: {mutation}"
    assert mutation.new != mutation.old
    assert all((ROOT / test.split("::")[0]).is_file() for test in mutation.tests)


def test_names_are_unique_and_say_what_is_wrong() -> None:
    assert Counter(m.name for m in EVERY).most_common(1)[0][1] == 1
    assert len(EVERY) >= 60
    parts = ("maths", "estimate", "compensate", "files", "kernels")
    assert {m.file.split("/")[1] for m in EVERY} >= set(parts)


def test_a_mistake_that_a_test_notices_is_killed(tree: Path) -> None:
    outcome = tried(HALF, tree)
    assert outcome.killed and outcome.killer == "test_code.py::test_half"
    assert "x / 2" in (tree / "half_code.py").read_text("utf-8")  # the tree itself is untouched


def test_one_that_no_test_notices_survives(tree: Path) -> None:
    comment = Mutation("of y", "half_code.py", "of x", "of y", ("test_code.py",))
    assert not tried(comment, tree).killed


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "x",
            "y",
            r"half: half_code\.py holds 'x' 3 times, not once; correct mutations/list\.toml",
        ),
        ("def half", "def third", r"half: the tests do not run: .*ERROR test_code"),
    ],
)
def test_a_run_that_means_nothing_is_refused(tree: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(Broken, match=f"(?s){message}"):
        tried(Mutation("half", "half_code.py", old, new, ("test_code.py",)), tree)


def test_survivors_stand_first_with_their_argument() -> None:
    argued = Mutation("a", "a.py", "1", "2", (), "nobody sees it")
    bare, killed = Mutation("b", "b.py", "1", "2", ()), Mutation("c", "c.py", "1", "2", ())
    outcomes = [
        Outcome(killed, "test_c.py::test", 1.0),
        Outcome(argued, "", 1.0),
        Outcome(bare, "", 1.0),
    ]
    text = "\n".join(table(outcomes))
    assert "1 of 3 small mistakes are killed" in text
    rows = [line for line in text.splitlines() if line.startswith(("| a", "| b", "| c"))]
    assert rows == [
        "| a | a.py | nobody sees it |",
        "| b | b.py | no argument: it needs a test |",
        "| c | c.py | test_c.py::test |",
    ]
