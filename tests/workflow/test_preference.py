"""The study of preference: the folder, what the page knows, what is found, what is refused."""

import csv
import json
import re
import zlib
from collections.abc import Callable, Iterator, Sequence
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from linear_pictures import write_picture
from tiny_venue import Ran
from tiny_venue import procam as run_command

from procam.compensate.compensator import Compensator
from procam.files.images.pixels import read_image, write_image
from procam.files.images.stills import read_picture
from procam.maths.light.curves import srgb_decode
from procam.model.calibration import Calibration
from procam.workflows.playout.explain import METHODS
from procam.workflows.sample_content import half_sky
from studies.preference import pictures
from studies.preference.__main__ import app
from studies.preference.answers import COLUMNS
from studies.preference.statistics import preference

pytest.importorskip("jinja2", reason="needs the extra `report`")

SIZE, SMALL = 48, 32
ONE_CODE = 1.5 / 255  # of an sRGB value: dithered to either neighbour
Row = dict[str, Any]
Chooser = Callable[[str, str, str], bool]  # content, first, second: whether the first is preferred


def preference_study(*arguments: object) -> Ran:
    return run_command(*arguments, command=app)


@pytest.fixture(scope="module")
def contents(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two pictures with one stem, and a third: dark, with bright rims."""
    folder = tmp_path_factory.mktemp("contents")
    paths = [folder / "sky.png", folder / "night" / "sky.png", folder / "hall.exr"]
    sky = half_sky(SIZE)
    for path, light in zip(paths, (sky, sky**4, np.rot90(sky) * 0.7), strict=True):
        path.parent.mkdir(exist_ok=True)
        write_picture(path, light)
    return paths


@pytest.fixture(scope="module")
def asked_dir(kept: Path, contents: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("made") / "test"
    ran = preference_study("ask", kept, out, *contents)
    assert ran.code == 0, ran
    return out


def plan_of(out: Path) -> dict[str, Any]:
    document = json.loads((out / "plan.json").read_text("utf-8"))
    assert isinstance(document, dict)
    return document


class _Embedded(HTMLParser):
    """The text of the element whose id is `plan`."""

    def __init__(self) -> None:
        super().__init__()
        self.text, self._inside = "", False

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._inside = ("id", "plan") in attrs

    def handle_data(self, data: str) -> None:
        self.text += data if self._inside else ""


def embedded(out: Path) -> dict[str, Any]:
    """What the page knows of the plan."""
    parser = _Embedded()
    parser.feed((out / "page.html").read_text("utf-8"))
    document = json.loads(parser.text)
    assert isinstance(document, dict)
    return document


def answered(out: Path, observer: str, prefers: Chooser, seed: int = 0) -> list[Row]:
    """The answers of one observer, who knows no more than the page does."""
    plan, rng = embedded(out), np.random.default_rng(seed)
    asked = [
        (question["content"], question["pictures"][:: -1 if i % 2 else 1])
        for question in plan["questions"]
        for i in range(question["times"])
    ]
    rows = list[Row]()
    for number, place in enumerate(rng.permutation(len(asked)), 1):
        content, (first, second) = asked[place]
        chosen = first if prefers(content, first, second) else second
        values = (plan["plan"], observer, number, content, first, second, chosen)
        rows.append(dict(zip(COLUMNS, (*values, int(chosen == first), 2500, 3), strict=True)))
    return rows


def save(path: Path, rows: Sequence[Row], names: Sequence[str] = COLUMNS) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, names, extrasaction="ignore")
        table.writeheader()
        table.writerows(rows)
    return path


def who_prefers(out: Path, shares: dict[str, float], seed: int) -> Chooser:
    """A person who prefers one method to another with a probability: its share over both.

    Chance is that of content and methods, not of names and orders, which change with the version.
    """
    made = {file: entry["method"] for file, entry in plan_of(out)["pictures"].items()}
    chance = dict[str, np.random.Generator]()

    def prefers(content: str, first: str, second: str) -> bool:
        a, b = sorted((made[first], made[second]))
        about = f"{seed} {content} {a} {b}"
        rng = chance.setdefault(about, np.random.default_rng(zlib.crc32(about.encode())))
        return bool(rng.random() < shares[a] / (shares[a] + shares[b])) == (made[first] == a)

    return prefers


def always(out: Path, method: str) -> Chooser:
    """A person who prefers a method, and exact to none."""
    worth = {"none": 0, "exact": 1, "least-squares": 1, "perceptual": 1} | {method: 2}
    made = {file: entry["method"] for file, entry in plan_of(out)["pictures"].items()}
    return lambda content, first, second: worth[made[first]] > worth[made[second]]


def document(*arguments: object) -> dict[str, Any]:
    ran = preference_study(*arguments, "--json")
    assert (ran.code, ran.err) == (0, ""), ran
    found = json.loads(ran.out, parse_constant=pytest.fail)  # no NaN, no Infinity
    assert isinstance(found, dict)
    return found


class TestAsk:
    def test_the_folder(self, asked_dir: Path) -> None:
        plan = plan_of(asked_dir)
        files = {str(p.relative_to(asked_dir)) for p in asked_dir.rglob("*") if p.is_file()}
        assert files == {"page.html", "plan.json", *(f"pictures/{f}" for f in plan["pictures"])}
        assert (plan["calibration"], plan["methods"]) == ("0001", ["exact", "perceptual"])
        assert plan["command"].startswith("python -m studies.preference ask ")
        assert [c["name"] for c in plan["contents"]] == ["sky", "sky-2", "hall"]
        assert plan["catch"] == ["exact", "none"]
        made = {(p["content"], p["method"]) for p in plan["pictures"].values()}
        assert len(made) == len(plan["pictures"]) == 9
        asked = [(q["content"], q["times"], q["catch"]) for q in plan["questions"]]
        assert asked == [
            (name, times, catch)
            for name in ("sky", "sky-2", "hall")
            for times, catch in ((2, False), (1, True))
        ]

    def test_the_page_does_not_know_the_methods(self, asked_dir: Path) -> None:
        text = (asked_dir / "page.html").read_text("utf-8").lower()
        assert not [name for name in METHODS if name != "none" and name in text]
        assert "http" not in text  # it loads nothing from elsewhere
        page, plan = embedded(asked_dir), plan_of(asked_dir)
        assert set(page) == {"plan", "seed", "on_dome", "questions"}
        assert set(page["questions"][0]) == {"content", "pictures", "times"}
        pairs = [q["pictures"] for q in page["questions"]]
        assert pairs == sorted(sorted(pair) for pair in pairs)  # by names that say nothing
        assert len(pairs) == len(plan["questions"])
        assert all(re.fullmatch(r"[0-9a-f]{12}\.png", file) for file in plan["pictures"])

    def test_the_page_writes_the_columns_that_are_read(self, asked_dir: Path) -> None:
        text = (asked_dir / "page.html").read_text("utf-8")
        found = re.search(r"const COLUMNS = (\[.*?\]);", text)
        assert found is not None and json.loads(found[1]) == list(COLUMNS)

    def test_pictures_are_what_the_audience_would_see(
        self, asked_dir: Path, contents: list[Path], calibration: Calibration
    ) -> None:
        plan = plan_of(asked_dir)
        scales = {c["name"]: c["scale"] for c in plan["contents"]}
        paths = dict(zip(scales, contents, strict=True))
        brightest = dict.fromkeys(scales, 0.0)
        for file, entry in plan["pictures"].items():
            pixels = read_image(asked_dir / "pictures" / file)
            assert (pixels.dtype, pixels.shape) == (np.uint8, (SIZE, SIZE, 3))
            compensator = Compensator(calibration, SIZE, entry["method"], transfer_name="linear")
            name = entry["content"]
            light = compensator.predict(read_picture(paths[name])[0]).observed * scales[name]
            brightest[name] = max(brightest[name], light.max())
            low, high = (
                srgb_decode(np.clip(pixels / 255 + e, 0, 1)) for e in (-ONE_CODE, ONE_CODE)
            )
            assert ((low <= light) & (light <= high)).all()
        assert max(brightest.values()) == pytest.approx(1, abs=1e-5)  # not clipped

    def test_a_dome_is_sent_direct_light(
        self, kept: Path, contents: list[Path], calibration: Calibration, tmp_path: Path
    ) -> None:
        found = document("ask", kept, tmp_path / "a", contents[0], "--on-dome", "--repeats", 1)
        assert (found["on_dome"], embedded(tmp_path / "a")["on_dome"]) == (True, True)
        content = read_picture(contents[0])[0]
        for file, entry in plan_of(tmp_path / "a")["pictures"].items():
            pixels = read_image(tmp_path / "a" / "pictures" / file) / 255
            compensator = Compensator(calibration, SIZE, entry["method"], transfer_name="linear")
            direct = compensator.predict(content).direct
            low, high = (srgb_decode(np.clip(pixels + e, 0, 1)) for e in (-ONE_CODE, ONE_CODE))
            assert ((low <= direct) & (direct <= high)).all()

    def test_a_monitor_gets_small_pictures_and_a_dome_whole_ones(
        self, kept: Path, contents: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(pictures, "MOST_ON_MONITOR", SMALL)
        for name, size, more in (("a", SMALL, ()), ("b", SIZE, ("--on-dome",))):
            document("ask", kept, tmp_path / name, contents[0], *more)
            plan = plan_of(tmp_path / name)
            assert plan["contents"][0]["size_px"] == size
            shapes = {read_image(p).shape for p in (tmp_path / name / "pictures").iterdir()}
            assert shapes == {(size, size, 3)}

    def test_equal_tests_have_equal_plans(
        self, kept: Path, contents: list[Path], tmp_path: Path
    ) -> None:
        """So answers to either can be analysed together; any other test has another id."""
        options = {"a": (), "b": (), "c": ("--repeats", 3), "d": ("--white", "keep")}
        ids = {n: document("ask", kept, tmp_path / n, contents[0], *o) for n, o in options.items()}
        assert ids["a"]["plan"] == ids["b"]["plan"]
        assert len({found["plan"] for found in ids.values()}) == 3
        assert embedded(tmp_path / "a") == embedded(tmp_path / "b")

    def test_without_catch_trials_where_their_pair_is_asked_about(
        self, kept: Path, contents: list[Path], tmp_path: Path
    ) -> None:
        found = document(
            *("ask", kept, tmp_path / "a", *contents[:2]),
            *("--methods", "none, exact,least-squares", "--repeats", 3),
        )
        assert (found["pictures"], found["trials"], found["catch_trials"]) == (6, 18, 0)
        assert plan_of(tmp_path / "a")["catch"] is None

    def test_equal_pictures_are_noted(self, kept: Path, tmp_path: Path) -> None:
        write_picture(tmp_path / "grey.png", np.full((SIZE, SIZE, 3), 0.4, np.float32))
        ran = preference_study("ask", kept, tmp_path / "a", tmp_path / "grey.png")
        assert ran.code == 0
        assert "note: grey: exact and perceptual give the same picture, so answers" in ran.err

    def test_more_than_eight_bits_hold_is_noted(self, kept: Path, tmp_path: Path) -> None:
        write_picture(tmp_path / "sun.exr", np.full((SIZE, SIZE, 3), 1.6, np.float32))
        ran = preference_study("ask", kept, tmp_path / "a", tmp_path / "sun.exr", "--on-dome")
        assert re.search(r"note: sun, none: \d+ pixels ask for more than 1\.0", ran.err)

    @pytest.mark.parametrize(
        ("options", "words"),
        [
            (
                ("--methods", "exact,best"),
                "--methods: 'best' is unknown; choose two or more of none,",
            ),
            (("--methods", "exact"), "--methods: exact are not two or more different ones; name"),
            (("--methods", "exact,exact"), "exact,exact are not two or more different ones"),
            (("--methods", "exact,none,exact"), "exact,none,exact are not two or more different"),
            (("--repeats", 0), "--repeats is 0; it must be 1 or more, such as 2"),
            (("--methods", "exact,none", "--db", 1), "--db: for the method perceptual, which"),
            (("--white", "red"), "white"),
            (("--state", "full"), "full"),
            (("--transfer", "log"), "log"),
        ],
    )
    def test_what_cannot_be_asked_is_refused(
        self,
        options: tuple[object, ...],
        words: str,
        kept: Path,
        contents: list[Path],
        tmp_path: Path,
    ) -> None:
        ran = preference_study("ask", kept, tmp_path / "a", contents[0], *options)
        assert (ran.code, words in ran.complaint.replace("\n", " ")) == (2, True), ran
        assert not list(tmp_path.iterdir())

    def test_nothing_is_overwritten(self, kept: Path, contents: list[Path], tmp_path: Path) -> None:
        (tmp_path / "full").mkdir()
        (tmp_path / "full" / "mine.txt").write_text("mine")
        for out in (tmp_path / "full", tmp_path / "full" / "mine.txt"):
            ran = preference_study("ask", kept, out, contents[0])
            assert (ran.code, "exists already and is not empty" in ran.complaint) == (2, True)
        (tmp_path / "empty").mkdir()
        assert preference_study("ask", kept, tmp_path / "empty", contents[0]).code == 0

    def test_a_wrong_picture_is_refused_before_any_is_made(
        self, kept: Path, contents: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        write_image(tmp_path / "wide.png", np.zeros((8, 12, 3), np.uint8))
        (tmp_path / "text.png").write_text("no picture")
        monkeypatch.setattr(pictures, "linear_compensator", None)
        for name, words in (("wide.png", "12x8 px is no dome master"), ("text.png", "text.png")):
            ran = preference_study("ask", kept, tmp_path / "a", contents[0], tmp_path / name)
            assert (ran.code, words in ran.complaint) == (2, True)
            assert not (tmp_path / "a").exists()


@pytest.fixture(scope="module")
def twelve(asked_dir: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """12 people, of whom most prefer the perceptual method with a probability of three quarters."""
    folder = tmp_path_factory.mktemp("answers")
    for number in range(12):
        shares = {"none": 0.01, "exact": 1, "perceptual": 3 if number < 10 else 1}
        prefers = who_prefers(asked_dir, shares, number)
        rows = answered(asked_dir, f"p{number}", prefers, number)
        save(folder / f"answers-p{number}.csv", rows)
    return folder


class TestAnswers:
    def test_shares_are_means_over_people(self, asked_dir: Path, twelve: Path) -> None:
        found = document("answers", asked_dir, twelve)
        assert (found["observers"], found["choices"]) == (12, 72)
        plan, shares, by_content = (
            plan_of(asked_dir),
            dict[str, list[bool]](),
            dict[str, list[bool]](),
        )
        for path in twelve.iterdir():
            with path.open(newline="") as file:
                for row in csv.DictReader(file):
                    methods = {
                        plan["pictures"][row[side]]["method"] for side in ("first", "second")
                    }
                    if methods == {"exact", "perceptual"}:
                        preferred = plan["pictures"][row["chosen"]]["method"] == "exact"
                        shares.setdefault(row["observer"], []).append(preferred)
                        by_content.setdefault(row["content"], []).append(preferred)
        expected = preference(np.array([np.mean(each) for each in shares.values()]))
        (pair,) = found["pairs"]
        assert (pair["first"], pair["second"]) == ("exact", "perceptual")
        assert (pair["observers"], pair["choices"]) == (12, 72)
        names = {"share": "share", "share_low": "low", "share_high": "high", "p_value": "p_value"}
        names |= {"sign_test_p_value": "sign_p", "jod": "jod", "sigma": "sigma"}
        for name, attribute in names.items():
            assert pair[name] == pytest.approx(getattr(expected, attribute)), name
        assert pair["p_value_together"] == pair["p_value"]
        assert {n: c["share"] for n, c in pair["contents"].items()} == pytest.approx(
            {name: np.mean(each) for name, each in by_content.items()}
        )
        needed = pair["observers_needed"]
        assert needed["0.55"] > needed["0.60"] > needed["0.75"] >= 2
        assert set(needed) == {"found", "0.55", "0.60", "0.75"}

    def test_the_finding_in_words(self, asked_dir: Path, twelve: Path) -> None:
        pair = document("answers", asked_dir, twelve)["pairs"][0]
        ran = preference_study("answers", asked_dir, *sorted(twelve.iterdir()))
        share, low, high = (100 * (1 - pair[n]) for n in ("share", "share_high", "share_low"))
        expected = (
            f"12 observers, 72 choices: perceptual preferred over exact in {share:.0f} % "
            f"(95 %: {low:.0f}..{high:.0f} %), p "
        )
        assert ran.out.startswith(expected)
        assert f"  {pair['prefer_second']} observers prefer perceptual, " in ran.out
        assert re.search(r"^  distance \d\.\d\d \(\d\.\d\d \.\. \d\.\d\d\) JOD$", ran.out, re.M)
        assert re.search(r"as these do: \d+ at \d+ %, \d+ at 55 %, \d+ at 60 %, ", ran.out)
        for name, each in pair["contents"].items():
            row = next(
                line.split() for line in ran.out.splitlines() if line.startswith(f"  {name} ")
            )
            assert row[1:4] == ["12", "24", f"{100 * (1 - each['share']):.0f}"]

    def test_no_more_is_claimed_than_was_found(self, asked_dir: Path, tmp_path: Path) -> None:
        for number in range(8):
            prefers = who_prefers(asked_dir, {"none": 0.01, "exact": 1, "perceptual": 1}, number)
            save(tmp_path / f"{number}.csv", answered(asked_dir, str(number), prefers))
        out = preference_study("answers", asked_dir, tmp_path).out
        assert out.startswith("8 observers, 48 choices: no preference found between ")
        assert "preferred over" not in out

    def test_one_observer_is_no_sample(self, asked_dir: Path, tmp_path: Path) -> None:
        rows = answered(asked_dir, "Ann, 7", always(asked_dir, "perceptual"))
        path = save(tmp_path / "a.csv", rows)
        found = document("answers", asked_dir, path)
        (pair,) = found["pairs"]
        assert [pair[n] for n in ("share_low", "share_high", "p_value", "jod")] == [None] * 4
        assert pair["observers_needed"]["found"] is None
        assert found["catch_trials"] == {"answered": 3, "failed": 0}
        out = preference_study("answers", asked_dir, path).out
        assert out.startswith(
            "1 observer, 6 choices: perceptual chosen over exact in 100 %; no interval, because one person"
        )
        assert "note: 1 observer: too few to conclude anything about other people" in out
        assert "JOD" not in out

    def test_people_who_all_agree_have_no_spread(self, asked_dir: Path, tmp_path: Path) -> None:
        for name in "abcdef":
            save(tmp_path / f"{name}.csv", answered(asked_dir, name, always(asked_dir, "exact")))
        out = preference_study("answers", asked_dir, tmp_path).out
        assert "exact chosen over perceptual in 100 %; no interval, because observers do not" in out
        assert "6 observers prefer exact, 0 perceptual, 0 neither: sign test p = 0.031" in out

    def test_several_pairs_are_counted_together(
        self, kept: Path, contents: list[Path], tmp_path: Path
    ) -> None:
        out = tmp_path / "test"
        document(
            "ask", kept, out, contents[0], "--methods", "none,exact,perceptual", "--repeats", 4
        )
        for number in range(6):
            prefers = who_prefers(out, {"none": 0.7, "exact": 1, "perceptual": 1.5}, number)
            save(tmp_path / "a" / f"{number}.csv", answered(out, f"o{number}", prefers))
        found = document("answers", out, tmp_path / "a")
        assert [(p["first"], p["second"]) for p in found["pairs"]] == [
            ("none", "exact"),
            ("none", "perceptual"),
            ("exact", "perceptual"),
        ]
        least = min(found["pairs"], key=lambda p: p["p_value"])
        assert least["p_value_together"] == pytest.approx(3 * least["p_value"])
        assert "with all 3 pairs counted" in preference_study("answers", out, tmp_path / "a").out
        assert "one content: what holds for it" in " ".join(found["notes"])

    def test_a_spreadsheet_may_have_saved_the_file(self, asked_dir: Path, tmp_path: Path) -> None:
        """With a byte order mark, semicolons, empty lines and other line ends."""
        path = save(
            tmp_path / "a.csv",
            answered(
                asked_dir, "Zo\N{LATIN SMALL LETTER E WITH DIAERESIS}", always(asked_dir, "exact")
            ),
        )
        expected = document("answers", asked_dir, path)
        text = path.read_text("utf-8").replace(",", ";").replace("\n", "\r\n") + ";;;;;;;;;\r\n"
        (tmp_path / "b.csv").write_bytes(text.encode("utf-8-sig"))
        assert document("answers", asked_dir, tmp_path / "b.csv") == expected


@pytest.fixture(scope="module")
def long_dir(kept: Path, contents: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("long") / "test"
    assert preference_study("ask", kept, out, *contents, "--repeats", 6).code == 0
    return out


class TestNotes:
    def notes(self, out: Path, path: Path, change: Callable[[list[Row]], Iterator[Row]]) -> str:
        rows = list(change(answered(out, "Bo", always(out, "exact"))))
        return "\n".join(document("answers", out, save(path, rows))["notes"])

    def test_a_good_observer_is_not_noted(self, long_dir: Path, tmp_path: Path) -> None:
        assert "observer Bo" not in self.notes(long_dir, tmp_path / "a.csv", iter)

    @pytest.mark.parametrize("side", ["first", "second"])
    def test_one_side(self, side: str, long_dir: Path, tmp_path: Path) -> None:
        """Who takes one side also contradicts all own answers, as orders are exchanged."""
        notes = self.notes(
            long_dir,
            tmp_path / "a.csv",
            lambda rows: (
                r | {"chosen": r[side], "chosen_first": int(side == "first")} for r in rows
            ),
        )
        assert f"observer Bo: chose the picture shown {side} in 21 of 21 trials" in notes
        assert "observer Bo: gave the same answer again in 18 of 45 repeats, no more than" in notes

    def test_too_soon(self, long_dir: Path, tmp_path: Path) -> None:
        notes = self.notes(
            long_dir, tmp_path / "a.csv", lambda rows: (r | {"milliseconds": 400} for r in rows)
        )
        assert "observer Bo: chose within 400 ms (median), too soon to compare" in notes
        at = lambda rows: (r | {"milliseconds": 500} for r in rows)  # noqa: E731
        assert "ms" not in self.notes(long_dir, tmp_path / "b.csv", at)

    def test_failed_catch_trials(self, long_dir: Path, tmp_path: Path) -> None:
        rows = answered(long_dir, "Bo", always(long_dir, "none"))
        found = document("answers", long_dir, save(tmp_path / "a.csv", rows))
        assert found["catch_trials"] == {"answered": 3, "failed": 3}
        assert "observer Bo: preferred none to exact in 3 of 3 catch trials" in found["notes"]
        assert found["choices"] == 18  # catch trials are not among them
        assert (
            "catch trials: 3 of 3 failed"
            in preference_study("answers", long_dir, tmp_path / "a.csv").out
        )

    def test_incomplete(self, long_dir: Path, tmp_path: Path) -> None:
        notes = self.notes(long_dir, tmp_path / "a.csv", lambda rows: iter(rows[:-2]))
        assert "observer Bo: 19 of 21 answers; the others are missing" in notes

    def test_a_pair_that_nobody_has_answered(self, long_dir: Path, tmp_path: Path) -> None:
        plan = plan_of(long_dir)
        catch = {tuple(sorted(q["pictures"])) for q in plan["questions"] if q["catch"]}
        notes = self.notes(
            long_dir,
            tmp_path / "a.csv",
            lambda rows: (r for r in rows if tuple(sorted((r["first"], r["second"]))) in catch),
        )
        assert "exact against perceptual: nobody has answered" in notes


def _other_side(rows: list[Row], _: Any) -> None:
    rows[2]["chosen_first"] = 1 - int(str(rows[2]["chosen_first"]))


def _none_of_the_two(rows: list[Row], plan: dict[str, Any]) -> None:
    rows[2]["chosen"] = next(file for file in plan["pictures"] if file not in rows[2].values())


def _not_compared(rows: list[Row], plan: dict[str, Any]) -> None:
    entries = plan["pictures"].items()
    one, two = (next(f for f, e in entries if e["content"] == c) for c in ("sky", "hall"))
    rows[2] |= {"first": one, "second": two, "chosen": one, "chosen_first": 1}


def _once_more(rows: list[Row], _: Any) -> None:
    rows.append(rows[-1] | {"trial": 99})


class TestRefusals:
    @pytest.fixture
    def rows(self, asked_dir: Path) -> list[Row]:
        return answered(asked_dir, "Bo", always(asked_dir, "exact"))

    def complaint(self, *arguments: object) -> str:
        ran: Ran = preference_study("answers", *arguments)
        assert ran.code == 2, ran
        return ran.complaint

    @pytest.mark.parametrize(
        ("change", "words"),
        [
            ({"plan": "0123"}, "4: these are answers to plan '0123', but OUT holds plan '"),
            ({"first": "x.png"}, "4: picture 'x.png' is not one of the plan's; take the file"),
            ({"chosen": "y.png"}, "4: picture 'y.png' is not one of the plan's; take"),
            ({"observer": " "}, "4: the observer has no name; write one in that cell"),
            ({"milliseconds": "soon"}, "4: milliseconds is 'soon'; it must be a number"),
            ({"milliseconds": -1}, "4: milliseconds is '-1'; it must be a number"),
            ({"milliseconds": "nan"}, "4: milliseconds is 'nan'; it must be a number"),
            ({"trial": 1}, "4: observer 'Bo' has answered trial 1 already; are two people"),
            (_other_side, r"4: chosen_first is '\d', but the chosen picture was shown (fir|sec)"),
            (_none_of_the_two, r"4: the chosen picture \w+\.png is neither of the two shown, "),
            (
                _not_compared,
                r"4: the plan does not ask for \w+\.png against \w+\.png; take the file",
            ),
            (_once_more, r"11: answer \d of observer 'Bo' to a question that the plan"),
        ],
    )
    def test_wrong_answers(
        self, change: Any, words: str, rows: list[Row], asked_dir: Path, tmp_path: Path
    ) -> None:
        if isinstance(change, dict):
            rows[2] |= change
        else:
            change(rows, plan_of(asked_dir))
        found = self.complaint(asked_dir, save(tmp_path / "a.csv", rows))
        assert re.search(rf"a\.csv:{words}", found), found

    @pytest.mark.parametrize("name", ["Bo", "bO"])
    def test_one_observer_in_two_files(
        self, name: str, rows: list[Row], asked_dir: Path, tmp_path: Path
    ) -> None:
        """Names may differ in case alone."""
        one = save(tmp_path / "a.csv", rows)
        two = save(tmp_path / "b.csv", [row | {"observer": name} for row in rows])
        found = self.complaint(asked_dir, tmp_path)
        assert f"observer {name!r} is in {one} and in {two}; remove one of the files" in found

    def test_a_missing_column(self, rows: list[Row], asked_dir: Path, tmp_path: Path) -> None:
        path = save(tmp_path / "a.csv", rows, [c for c in COLUMNS if c not in ("chosen", "trial")])
        found = self.complaint(asked_dir, path)
        assert (
            "a.csv: the column trial, chosen is missing; the first line must be plan,obs" in found
        )

    def test_no_answers(self, asked_dir: Path, tmp_path: Path) -> None:
        assert "no answers; give the answers-*.csv" in self.complaint(asked_dir, tmp_path)
        path = save(tmp_path / "a.csv", [])
        assert f"{path}: no answers in it; take the file" in self.complaint(asked_dir, path)
        path.write_text("")
        assert "a.csv: the column plan, observer" in self.complaint(asked_dir, path)

    def test_no_table(self, rows: list[Row], asked_dir: Path, tmp_path: Path) -> None:
        (tmp_path / "a.csv").write_bytes(b"\xff\xfe\x00plan")
        assert "a.csv is no table (" in self.complaint(asked_dir, tmp_path / "a.csv")
        path = save(tmp_path / "b.csv", rows)
        path.write_text(path.read_text() + "one,two\n")
        found = self.complaint(asked_dir, path)
        assert "b.csv:11: the line has 2 cells, and the first line 10; take the file" in found
        assert "c.csv: no such file; give the" in self.complaint(asked_dir, tmp_path / "c.csv")

    def test_a_folder_without_a_sound_plan(
        self, rows: list[Row], asked_dir: Path, tmp_path: Path
    ) -> None:
        path = save(tmp_path / "a.csv", rows)
        assert "plan.json: no such file; OUT is the folder" in self.complaint(tmp_path, path)
        plan = plan_of(asked_dir)
        for spoil, words in (
            ({"repeats": 0}, "plan.json is damaged (repeats: "),
            ({"pictures": {}}, "plan.json is damaged: it asks for picture "),
        ):
            (tmp_path / "plan.json").write_text(json.dumps(plan | spoil))
            assert words in self.complaint(tmp_path, path)
        (tmp_path / "plan.json").write_text("{")
        assert "plan.json is damaged (it: " in self.complaint(tmp_path, path)
