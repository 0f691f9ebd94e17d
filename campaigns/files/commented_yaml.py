"""Settings as a YAML file that explains each of its keys."""

from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.scalarstring import DoubleQuotedScalarString

from campaigns.files.yamlfile import FileModel, yaml_text

INDENT = 2


def commented_yaml(schema: str, settings: FileModel) -> str:
    """Write every key of the settings, each below its description."""
    tree = CommentedMap(schema=schema)
    _add(tree, settings, column=0)
    return yaml_text(tree)


def _add(tree: CommentedMap, settings: FileModel, column: int) -> None:
    for name, field in type(settings).model_fields.items():
        tree[name] = _value(getattr(settings, name), column + INDENT)
        gap = "\n" if column == 0 else ""
        tree.yaml_set_comment_before_after_key(
            name, before=f"{gap}{field.description}", indent=column
        )


def _value(value: object, column: int) -> object:
    if isinstance(value, FileModel):
        section = CommentedMap()
        _add(section, value, column)
        return section
    if isinstance(value, tuple):
        entries = CommentedSeq(value)
        entries.fa.set_flow_style()
        return entries
    if isinstance(value, str) and not value.isprintable():
        return DoubleQuotedScalarString(value)  # with escapes, so that no sign gets lost
    return value
