"""Every command of five how-to pages runs, in the order of the page, on small simulated domes.

A page's lines in ```sh blocks, and `procam ...` and `python ...` in backticks are run as they stand, in a
folder that has what the page takes for granted: `my-dome` is calibrated, `sky.png` is there. Venues are made
small after `procam init`. What the first page has run is not run again by those that follow it. The tables
below are the only exceptions; each has its reason.
"""

import ast
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import photographer
import pytest
from tiny_venue import TINY_PAIR, procam

from procam.estimate.light import floor_albedo, model_room
from procam.files.images.pixels import write_image
from procam.files.venue.load import load_venue, template_text
from procam.interfaces.cli import _sessions
from procam.interfaces.cli.main import COMMANDS, GROUPS
from procam.interfaces.plots import figure
from procam.workflows import stills
from procam.workflows.refine import refine
from simulators.scene import SceneSize
from simulators.template import server_text, venue_text
from studies.__main__ import STUDIES

ROOT = Path(__file__).parents[2]
HOWTO = ROOT / "docs" / "howto"
CALIBRATED = ("monthly-check", "troubleshooting", "devices")  # pages that take it for granted
PAGES = ("first-dome", "through-server", *CALIBRATED)
COMMAND = re.compile(
    r"^```sh\n(?P<block>.*?)^```|`(?P<inline>(?:procam|python) [^`\n]+)`", re.M | re.S
)
QUOTED = re.compile(r'"([^"]+)"')
# what stands for a name or a number in a quoted message
VALUE = re.compile(r"\s*\.\.\.\s*|\b[NDRS]\b|\d[\d.]*|\[w, h\]|\(.*\)|standby|b''|`|, not on,")

# edges [px] of dome masters of the server, of maps and of pictures; resolution of plots
MASTER, MAPS, PICTURE, COARSE_DPI = 512, 64, 96, 20
DOME = replace(TINY_PAIR, map_size=MAPS)
BEHIND_SERVER = SceneSize(
    projectors=2, projector_size=(400, 250), camera_size=(420, 420), rays=64, map_size=MAPS
)
FLOOR_SECTORS = 12  # of the room in which the floor is estimated

# first words of lines that other programs run, and why not here
OTHERS = {
    "git": "needs a network",
    "cd": "into the repository, where this test is",
    "make": "makes an environment; that its target exists is checked",
    ".": "the environment is active already",
}
# commands that are not run here, and where they are
ELSEWHERE = {
    "procam demo --preset server": "takes a minute; its steps are those of test_server.py",
}
# commands that end in another way here than with 0: exit code, and the message
REFUSED = {
    "procam refine my-dome": (1, "stays newest"),  # so small a dome gains nothing from the loop
    "procam meter my-dome meter.csv": (2, "it must hold"),
    "procam projector my-dome north shutter closed": (1, "switch it on first"),
    "procam projector my-dome north shutter open": (1, "switch it on first"),
    "procam projector my-dome north input 30": (1, "switch it on first"),
    "procam venue prune my-dome": (2, "[history] with keep_sessions"),
}
# the page's [unattended] with programs that are here, at any hour
UNATTENDED = {
    '"/usr/local/bin/dome-is-empty"': '"true"',
    '"/usr/local/bin/write-crew"': '"true"',
    '"03:00"': '"00:00"',
    '"05:30"': '"23:59"',
}


def read(page: str) -> str:
    return (HOWTO / f"{page}.md").read_text("utf-8")


def blocks(text: str) -> list[list[str]]:
    """The lines of each ```sh block, without comments."""
    found = [each["block"] for each in COMMAND.finditer(text) if each["block"]]
    return [[shlex.join(words) for words in map(words_of, b.splitlines()) if words] for b in found]


def words_of(line: str) -> list[str]:
    """A shell's words of a line, without its comment."""
    return shlex.split(line, comments=True)


def commands(text: str) -> list[list[str]]:
    """Words of all commands of a page, each once, in order; `procam NAME` alone only names one."""
    found = list[list[str]]()
    for each in COMMAND.finditer(text):
        if each["block"]:
            found += [words for words in map(words_of, each["block"].splitlines()) if words]
        elif " ".join(words_of(each["inline"])[1:]) not in {*COMMANDS, *GROUPS}:
            found.append(words_of(each["inline"]))
    return [words for i, words in enumerate(found) if words not in found[:i]]


def by_hand_text() -> str:
    """A small dome behind a media server as its owner drives it: by hand."""
    text = server_text(BEHIND_SERVER, MASTER).split("[simulated]")[0]
    return re.sub(r'(?m)^(backend|control) = .*"simulated".*\n|^control = .*\n', "", text)


# what `procam init` writes, in a small dome
SMALL: dict[str, Callable[[], str]] = {
    "simulated-six-projectors": lambda: venue_text("standard", DOME),
    "simulated-server": lambda: server_text(BEHIND_SERVER, MASTER),
    "through-server": by_hand_text,
}


def run(words: list[str]) -> None:
    """Run one command of a page in the present folder, and check how it ends."""
    line = shlex.join(words)
    if words[0] in OTHERS:
        if words[0] == "make":
            assert re.search(rf"(?m)^{words[1]}:", (ROOT / "Makefile").read_text("utf-8")), line
        return
    if words[0] == "cp":
        shutil.copy(*words[1:])
        return
    if words[:3] == ["python", "-m", "studies"]:
        assert set(words[3:]) <= set(STUDIES), line
        return
    if words[0] == "python":
        subprocess.run([sys.executable, *words[1:]], check=True, stdout=subprocess.DEVNULL)
        return
    assert words[0] == "procam", f"{line}: no command of procam"
    if line in ELSEWHERE:
        return
    if words[1] == "init" and Path(words[2]).exists():  # one that a page only mentions
        words = [*words[:2], f"another-{words[-1]}", *words[3:]]
    code, message = REFUSED.get(line, (0, ""))
    ran = procam(*words[1:])
    assert (ran.code, message in ran.out + ran.err) == (code, True), f"{line}: {ran}"
    if words[1] == "init":
        make_small(Path(words[2]), words[words.index("--template") + 1])
    if words[1:3] == ["session", "plan"]:
        take_photographs(Path(words[4]))


def run_all(*pages: str, after: str = "") -> None:
    """Run the commands of pages, each once, without those that a page had `after` which they run."""
    done = commands(read(after)) if after else []
    for words in commands("\n".join(map(read, pages))):
        if words not in done:
            run(words)


def make_small(venue: Path, template: str) -> None:
    """Make a venue small that `procam init` has just written."""
    assert (venue / "venue.toml").read_text("utf-8") == template_text(template)
    if template in SMALL:
        (venue / "venue.toml").write_text(SMALL[template](), "utf-8")


def take_photographs(pictures: Path) -> None:
    """Photograph what `procam session plan` has written, as people do with a camera."""
    Path("real-dome").mkdir()
    text = server_text(BEHIND_SERVER, MASTER)
    Path("real-dome/venue.toml").write_text(text, "utf-8")
    photographer.main(Path("real-dome"), pictures, Path("DCIM"))


@pytest.fixture(scope="module", autouse=True)
def small_and_quick() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(model_room, "SECTORS", FLOOR_SECTORS)
        patch.setattr(floor_albedo, "DROPS", (0.1,))
        patch.setattr(floor_albedo, "WALLS", (0.05,))
        # `procam report` writes one in full; those of `calibrate` and `solve` are its own in other tests
        patch.setattr(_sessions, "write_report", lambda venue: venue / "report.html")
        patch.setattr(refine, "MAX_CORRECTIONS", 1)
        patch.setattr(figure, "DPI", COARSE_DPI)
        patch.setattr(stills.write_stills, "__defaults__", (PICTURE,))
        yield


def write_pictures(folder: Path) -> None:
    """What people show: a picture, and a clip of two."""
    sky = np.full((PICTURE, PICTURE, 3), 60, np.uint8)
    sky[: PICTURE // 2] = 180
    for name in ("sky.png", "clip/sky.0001.png", "clip/sky.0002.png"):
        write_image(folder / name, sky)


def test_a_server_from_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write_pictures(tmp_path)
    run_all("through-server")
    assert [path.name for path in (tmp_path / "frames").iterdir()] == ["server.png"]


def test_a_first_dome_from_nothing_and_what_is_done_with_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write_pictures(tmp_path)
    run_all("first-dome")
    frames = sorted(path.name for path in (tmp_path / "frames").iterdir())
    assert frames == ["north.png", "south.png"]
    assert (tmp_path / "why" / "explained.png").is_file()
    assert (tmp_path / "target.preview.html").is_file()
    shutil.copytree("my-dome/calibrations/0002", "my-dome/calibrations/0003")
    schedule(Path("my-dome"))
    run_all(*CALIBRATED, after="first-dome")


def schedule(venue: Path) -> None:
    """Append [unattended] as the monthly check has it."""
    (table,) = re.findall(r"```toml\n(\[unattended\].*?)```", read("monthly-check"), re.S)
    for name, here in UNATTENDED.items():
        assert name in table
        table = table.replace(name, here)
    with (venue / "venue.toml").open("a", encoding="utf-8") as file:
        file.write(f"\n{table}")
    load_venue(venue)


def test_no_exception_is_left_over() -> None:
    """Each command of the tables is still in a page, and no block escapes the test by its name."""
    named = {name for page in PAGES for name in re.findall(r"^```(\w+)$", read(page), re.M)}
    assert named == {"sh", "toml", "ini"}
    lines = {shlex.join(words) for page in PAGES for words in commands(read(page))}
    assert {*REFUSED, *ELSEWHERE} <= lines
    assert {*OTHERS, "cp", "procam", "python"} == {line.split()[0] for line in lines}


def test_the_paths_are_short() -> None:
    assert len(blocks(read("first-dome"))[0]) <= 10
    assert [len(block) <= 6 for block in blocks(read("through-server"))] == [True, True]


def test_the_first_dome_has_six_projectors(tmp_path: Path) -> None:
    assert procam("init", tmp_path, "--template", "simulated-six-projectors").code == 0
    assert len(load_venue(tmp_path).table.projectors) == 6


def said() -> str:
    """What the programs can say, a text on each line, with _ for values."""
    texts = []
    for path in (
        path for folder in ("procam", "simulators") for path in (ROOT / folder).rglob("*.py")
    ):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.JoinedStr):
                parts = [p.value if isinstance(p, ast.Constant) else "_" for p in node.values]
                texts.append("".join(map(str, parts)))
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                texts.append(node.value)
    return "\n".join(" ".join(text.split()) for text in texts)


def quoted() -> list[str]:
    """Messages in the first columns of the tables of symptoms."""
    lines = read("troubleshooting").splitlines()
    found = [
        text for line in lines if line[:1] == "|" for text in QUOTED.findall(line.split("|")[1])
    ]
    (table,) = re.findall(r"\| message .*?\n\|[-|]+\n(.*?)\n\n", read("through-server"), re.S)
    return found + [line.split("|")[1].strip() for line in table.splitlines()]


def test_quoted_messages_are_those_of_the_code() -> None:
    """With names and numbers left out, so that a search for a message finds its line."""
    messages, code = quoted(), said()
    assert len(messages) > 50
    for message in messages:
        pattern = r"[^\n]*?".join(map(re.escape, VALUE.split(message)))
        assert re.search(pattern, code, re.IGNORECASE), message


@pytest.mark.parametrize(
    "line", ["procam nonesuch my-dome", "procam verify --fast my-dome", "reboot my-dome"]
)
def test_a_command_that_does_not_run_fails(
    line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for text in (f"```sh\n{line}   # a comment\n```\n", f"it is `{line}`"):
        found = commands(text)
        if text.startswith("```"):
            assert found == [line.split()]
        for words in found:
            with pytest.raises(AssertionError):
                run(words)
