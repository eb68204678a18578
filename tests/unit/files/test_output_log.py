"""The log that lets a killed run resume."""

from pathlib import Path

from procam.files.output_log import OutputLog, file_state


class TestOutputLog:
    def logged(self, tmp_path: Path, key: str = "k") -> tuple[OutputLog, Path, list[int]]:
        (tmp_path / "in.png").write_bytes(b"x")
        (tmp_path / "out.png").write_bytes(b"x")
        return (
            OutputLog(tmp_path / "log.jsonl", key),
            tmp_path / "out.png",
            file_state(tmp_path / "in.png"),
        )

    def test_an_output_of_the_same_source_and_settings_is_found(self, tmp_path: Path) -> None:
        log, out, state = self.logged(tmp_path)
        log.add(out, state, {"s": 0.5})
        assert OutputLog(log.path, "k").kept(out, state) == {"s": 0.5}

    def test_other_settings_sources_or_outputs_have_to_be_made_again(self, tmp_path: Path) -> None:
        log, out, state = self.logged(tmp_path)
        log.add(out, state, {})
        again = OutputLog(log.path, "k")
        assert OutputLog(log.path, "other").kept(out, state) is None
        assert again.kept(out, [state[0], state[1] + 1]) is None
        assert again.kept(tmp_path / "in.png", state) is None
        out.write_bytes(b"torn or other")
        assert again.kept(out, state) is None
        out.unlink()
        assert again.kept(out, state) is None

    def test_an_incomplete_line_affects_its_own_file_only(self, tmp_path: Path) -> None:
        log, out, state = self.logged(tmp_path)
        log.add(out, state, {"n": 1})
        with log.path.open("ab") as file:
            file.write(b'{"out": "out.p')
        log = OutputLog(log.path, "k")
        assert log.kept(out, state) == {"n": 1}
        (tmp_path / "next.png").write_bytes(b"y")
        log.add(tmp_path / "next.png", state, {"n": 2})
        again = OutputLog(log.path, "k")
        assert again.kept(out, state) == {"n": 1}
        assert again.kept(tmp_path / "next.png", state) == {"n": 2}

    def test_damaged_lines_are_ignored(self, tmp_path: Path) -> None:
        log, out, state = self.logged(tmp_path)
        log.path.write_text("[1, 2]\nhello\n")
        assert OutputLog(log.path, "k").kept(out, state) is None

    def test_a_value_that_is_another_has_no_effect(self, tmp_path: Path) -> None:
        log, out, state = self.logged(tmp_path)
        log.add(out, state, {"peak": 0.5})
        text = log.path.read_text()
        for changed in (
            text.replace("0.5", "0.7"),
            text.replace('"kept"', '"lost"'),
            text[:-12] + "\n",
        ):
            log.path.write_text(changed)
            assert OutputLog(log.path, "k").kept(out, state) is None
