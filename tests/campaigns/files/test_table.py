"""Tables: one list of columns for people and for programs."""

from campaigns.files.table import Column, csv_table, texts, words

COLUMNS = (
    words("name", lambda row: row[0]),
    Column("n", lambda row: row[1]),
    Column("Δ", lambda row: row[2], decimals=2, signed=True),
)
ROWS = [("a", 3, -0.125), ("=b", 0, None)]


def test_columns_make_of_rows_what_people_and_what_programs_read() -> None:
    assert texts(COLUMNS, ROWS) == (("a", "3", "−0.12"), ("=b", "0", "–"))
    assert csv_table(COLUMNS, ROWS) == "name,n,Δ\na,3,-0.125\n'=b,0,\n"
