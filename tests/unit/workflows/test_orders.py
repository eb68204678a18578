"""What people were asked to photograph, as it is on disk."""

from pathlib import Path

import pytest

from procam.errors import FileFormatError
from procam.workflows.photographs.orders import Document, read_document


def document(exposure_s: str) -> str:
    known = Document(of="", camera="c", exposure_s=0.1, rounds=0, pictures=0, photographs=[])
    return known.model_dump_json().replace("0.1", exposure_s)


def test_it_is_read_as_it_was_written(tmp_path: Path) -> None:
    (tmp_path / "wanted.json").write_text(document("0.25"))
    found = read_document(tmp_path)
    assert found is not None
    assert found.exposure_s == 0.25


@pytest.mark.parametrize("exposure", ["Infinity", "NaN", "1e308", "5e-324", "0", "-0.1"])
def test_exposures_that_no_camera_has(tmp_path: Path, exposure: str) -> None:
    """Their ratio to others may be infinite or zero."""
    (tmp_path / "wanted.json").write_text(document(exposure))
    with pytest.raises(FileFormatError, match="damaged"):
        read_document(tmp_path)
