"""Views of an identification: a text for the console, a table and a figure."""

import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from campaigns.files.table import Column, decimals_by, find_pandas, html_table, words

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from campaigns.identification.result import IdentificationResult, IdentifiedParameter


def report(result: "IdentificationResult") -> str:
    """Return parameters, budget and findings as text for a console."""
    # The budget's rows add up in squares: the last line is their root.
    judgement, uncertainty, value = result.judgement, result.uncertainty, result.value
    lines = [f"verdict: {judgement.verdict}", *(f"  {reason}" for reason in judgement.reasons), ""]
    lines.append(f"{'parameter':28}{'nominal':>12}{'identified':>12}{'± σ':>10}")
    for name in value.free:
        parameter = value.parameters[name]
        std = "held" if parameter.std is None else f"{parameter.std:.4f}"
        lines.append(f"{name:28}{parameter.nominal:12.4f}{parameter.value:12.4f}{std:>10}")
    if shares := uncertainty.budget:
        lines += ["", "uncertainty of positions, 1 σ, rms over the workspace, mm"]
        lines += [f"  {share.words:52} {share.kind} {share.mm:9.4f}" for share in shares]
        total = math.sqrt(sum(share.mm**2 for share in shares))
        lines.append(f"  {'combined':52}   {total:9.4f}")
    if uncertainty.scatter is not None:
        lines += ["", uncertainty.scatter.says]
    lines += ["", *(f"finding: {finding.says}" for finding in judgement.findings)]
    return "\n".join(lines).rstrip() + "\n"


def to_frame(result: "IdentificationResult") -> Any:
    """Return the parameters as a DataFrame; raise `ImportError` without pandas.

    Any: as of `find_pandas`.
    """
    parameters = result.value.parameters.items()
    rows = [{"parameter": name, **asdict(parameter)} for name, parameter in parameters]
    return find_pandas().DataFrame(rows).set_index("parameter")


def repr_html(result: "IdentificationResult") -> str:
    """Return verdict, reasons and identified parameters as a table for notebooks."""
    judgement, value = result.judgement, result.value
    rows = [(name, value.parameters[name]) for name in value.free]

    def decimals(row: tuple[str, "IdentifiedParameter"]) -> int:
        return decimals_by(row[1].std)

    columns: tuple[Column[tuple[str, IdentifiedParameter]], ...] = (
        words("parameter", lambda row: row[0]),
        Column("nominal", lambda row: row[1].nominal, decimals=decimals),
        Column("identified", lambda row: row[1].value, decimals=decimals),
        Column("Δ", lambda row: row[1].delta, decimals=decimals, signed=True),
        Column("σ", lambda row: row[1].std, decimals=decimals),
    )
    return html_table(f"{judgement.verdict}: {'; '.join(judgement.reasons)}", columns, rows)


def plot(result: "IdentificationResult", kind: str = "errors") -> "Figure":
    """Return a figure by its word: `"errors"`, `"space"`, `"correlations"` or `"gain"`.

    Raise `OptionsInvalid` for another word, and `ShotsMissing` where the result lacks its rows.
    """
    # slow to import: only what draws waits for matplotlib
    from campaigns.identification import pictures

    return pictures.plot(result, kind)
