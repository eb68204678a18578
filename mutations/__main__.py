"""Make the mistakes of list.toml, one at a time, and run the tests that must notice them.

python -m mutations          all of them; writes results.md beside this file
python -m mutations WORD...  those with a word in their name, definition or tests; writes nothing

Every mutation gets a copy of the tree of its own, so the working tree is never touched. First the same
tests run without any mutation. Exit 1 if fewer than `GOAL` are killed, 2 if a run means nothing.
"""

import os
import sys
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from mutations.definitions import read_definitions
from mutations.mutant import Broken, Mutation, Outcome, copied, failure, read_mutations, tried

HERE = Path(__file__).parent
ROOT = HERE.parent
GOAL = 0.9  # of the mutations, that tests must kill
JOBS = int(os.environ.get("JOBS", "2"))


def main(words: Sequence[str]) -> int:
    """Try the mutations that the words choose, or all."""
    every = read_mutations(HERE / "list.toml")
    chosen = [m for m in every if is_chosen(m, words)]
    try:
        check_unmutated(chosen)
        outcomes = list(tried_all(chosen))
    except Broken as error:
        print(f"mutations: {error}", file=sys.stderr)
        return 2
    if not words:
        (HERE / "results.md").write_text("\n".join(table(outcomes)) + "\n", encoding="utf-8")
    killed = sum(o.killed for o in outcomes)
    print(f"{killed} of {len(outcomes)} killed")
    return int(killed < GOAL * len(outcomes))


def is_chosen(mutation: Mutation, words: Sequence[str]) -> bool:
    """Whether a mutation has one of the words, or no word is given."""
    text = " ".join([mutation.name, mutation.definition, *mutation.tests])
    return not words or any(word in text for word in words)


def check_unmutated(mutations: Sequence[Mutation]) -> None:
    """Refuse old texts that are gone, tests that fail and kernels that do not build without any mutation."""
    definitions = read_definitions(ROOT)
    changed = [m.find(definitions) for m in mutations]
    targets = sorted({test for m in mutations for test in m.tests})
    with tempfile.TemporaryDirectory() as folder:
        copy = copied(ROOT, Path(folder) / "tree", kernels=any(d.is_c for d in changed))
        with ThreadPoolExecutor(JOBS) as pool:
            for found in pool.map(lambda test: failure(copy, [test]), targets):
                if found:
                    raise Broken(f"{found} fails without any mutation; mend that first")


def tried_all(mutations: Sequence[Mutation]) -> Iterator[Outcome]:
    """Outcomes in the order of the list, each printed when it is known."""
    with ThreadPoolExecutor(JOBS) as pool:
        for outcome in pool.map(lambda m: tried(m, ROOT), mutations):
            word = "killed  " if outcome.killed else "SURVIVED"
            print(f"{word} {outcome.seconds:6.1f} s  {outcome.mutation.name}", flush=True)
            yield outcome


def table(outcomes: Sequence[Outcome]) -> Iterator[str]:
    """The results as Markdown, survivors first."""
    killed = [o for o in outcomes if o.killed]
    survivors = [o for o in outcomes if not o.killed]
    yield "# Mutations"
    yield ""
    yield f"`make mutate`: {len(killed)} of {len(outcomes)} small mistakes are killed, that is, a test fails"
    yield f"({len(killed) / len(outcomes):.0%}; goal {GOAL:.0%}). `mutations/list.toml` has their exact text."
    if survivors:
        yield from ("", "| survivor | in | why it may live |", "|---|---|---|")
    for o in survivors:
        argument = o.mutation.lives or "no argument: it needs a test"
        yield f"| {o.mutation.name} | {o.mutation.definition} | {argument} |"
    yield from ("", "| killed | in | by |", "|---|---|---|")
    for o in killed:
        yield f"| {o.mutation.name} | {o.mutation.definition} | {o.killer} |"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
