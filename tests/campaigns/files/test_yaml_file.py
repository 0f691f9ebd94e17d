"""YAML files: whatever is in them is either read or answered with one line."""

from functools import partial

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from pydantic import Field
from refusals import refusal, refusal_if_any

from campaigns.errors import ConfigInvalid
from campaigns.files import yaml_file

SCHEMA = "pkmcal/test/1"


class Inner(yaml_file.FileModel):
    count: int = Field(default=1, ge=0, description="a count")


class Sample(yaml_file.FileModel):
    size_mm: float = Field(description="the size, mm")
    inner: Inner | None = Field(default=None, description="something inside")
    label: str = Field(default="", description="a label")


def read(text):
    return yaml_file.checked(yaml_file.parse_document(text, "sample.yaml"), SCHEMA, Sample)


answer_to = partial(refusal_if_any, ConfigInvalid, read)


complaint = partial(refusal, ConfigInvalid, read)


def with_schema(text):
    return f"schema: {SCHEMA}\n{text}"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "sample.yaml: is empty"),
        ("- 1\n- 2\n", "holds no keys with values"),
        ("a: [1, 2\n", "is not YAML"),
        ("a: *nowhere\n", "sample.yaml:1: has & or *"),
        ("schema: pkmcal/test/2\na: 1\n", "a newer pkmcal wrote the file"),
        ("a: 1\n---\nb: 2\n", "is not YAML"),
        ("a: \x00\n", "is not YAML"),
        ("%YAML 1.3\n---\na: 1\n", "directives"),
        ("a: !!float\n", "has tags"),
        ("day: 2024-13-45\n", "month must be in"),
        (with_schema("? [1, 2]\n: 3\n"), "more than plain keys"),
    ],
)
def test_what_is_no_plain_yaml_mapping_is_refused_in_one_line(text, words):
    said = complaint(text)
    assert words in said
    assert "\n" not in said


def test_values_are_taken_as_yaml_1_2_has_them():
    assert read(with_schema("size_mm: 1.0\nlabel: yes\n")).label == "yes"
    assert read(with_schema("size_mm: 1\n")).size_mm == 1.0
    said = complaint(with_schema("size_mm: 1\ninner: {count: 1.0}\n"))
    assert "inner.count is 1.0, must be a whole number" in said


def test_findings_are_counted_explained_and_shortened():
    said = complaint(with_schema("size_m: 1.0\nlabel: 3\n"))
    assert said.startswith("sample.yaml:2: size_m is not a known key (and 2 more)")
    said = complaint(with_schema("size_mm: 1.0\ninner:\n  count: -1\n"))
    assert said == "sample.yaml:4: inner.count is -1, must be at least 0 → give a count"
    said = complaint(with_schema(f"size_mm: {'long ' * 100}\n"))
    assert len(said) < 150


def test_a_file_is_utf_8_with_or_without_byte_order_mark_and_windows_line_ends(tmp_path):
    path = tmp_path / "sample.yaml"
    path.write_bytes(b"\xef\xbb\xbf" + with_schema("size_mm: 2.5\n").replace("\n", "\r\n").encode())
    document = yaml_file.read_document(path, if_missing="make it")
    assert yaml_file.checked(document, SCHEMA, Sample).size_mm == 2.5
    path.write_bytes(b"schema: x\nlabel: caf\xe9\n")
    says = r"sample\.yaml:2: byte 0xe9 is not UTF-8 text → save the file as plain text"
    with pytest.raises(ConfigInvalid, match=says):
        yaml_file.read_document(path, if_missing="make it")


def test_edited_tree_keeps_its_comments():
    text = "# above\na: 1.50  # beside\n\n# between\nb: {c: 2, d: 3}\n# below\n"
    tree = yaml_file.parse_document(text, "sample.yaml").editable_tree()
    tree["b"]["c"] = 7
    assert yaml_file.yaml_text(tree) == text.replace("c: 2", "c: 7")


@given(st.text() | st.text(st.sampled_from("{}[]:,-?&*!|>'\"%@`#~\n \ta1<"), max_size=25))
@example("?")
@example("- - -")
@example("!!set {a, b}")
@example("{a: 1, a: 2}")
@example("%YAML 9.9\n---\n")
@example("a: 2024-13-45")
def test_any_text_is_read_or_refused_with_config_invalid(text):
    assert "\n" not in answer_to(with_schema(text))
