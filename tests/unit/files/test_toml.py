"""Tables written as TOML are read back."""

from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from procam.files.toml import read_toml, toml_text

KEY = st.text("abcXYZ019_-", min_size=1, max_size=6)
TEXT = st.text(st.characters(exclude_categories=["Cs"]), max_size=12)
NUMBER = st.floats(allow_nan=False, allow_infinity=False) | st.integers(-(2**63), 2**63 - 1)
VALUE = st.booleans() | NUMBER | TEXT
PLAIN = VALUE | st.lists(VALUE, max_size=3) | st.lists(st.lists(NUMBER, max_size=2), max_size=2)
TABLE = st.dictionaries(KEY, PLAIN, min_size=1, max_size=3)
TABLES = st.dictionaries(
    KEY, TABLE | st.lists(TABLE, min_size=1, max_size=2) | st.dictionaries(KEY, TABLE, min_size=1)
)


@given(TABLES)
def test_tables_come_back(tmp_path_factory, tables) -> None:
    path = Path(tmp_path_factory.getbasetemp()) / "tables.toml"
    path.write_bytes(toml_text(tables).encode())
    assert read_toml(path) == tables
