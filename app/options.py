"""Arguments and options that several commands share, worded once."""

from pathlib import Path
from typing import Annotated

import typer

Folder = Annotated[Path, typer.Argument(metavar="DIR", help="The campaign's folder.")]
Json = Annotated[
    bool,
    typer.Option(
        "--json", help="One JSON document on stdout, talk on stderr; on an error no document."
    ),
]
Yes = Annotated[
    bool, typer.Option("--yes", "-y", help="Don't ask whether the cell is clear: it is.")
]
Dry = Annotated[bool, typer.Option("--dry", help="Say what would happen, and do nothing.")]
Anew = Annotated[
    bool, typer.Option("--anew", help="Begin a new series instead of resuming an unfinished one.")
]
Plot = Annotated[
    Path | None, typer.Option(metavar="FILE", help="Draw a picture too: .svg, .png or .pdf.")
]
Seed = Annotated[
    int | None, typer.Option(min=0, metavar="N", help="Another seed than the scenario's.")
]
Free = Annotated[
    list[str] | None,
    typer.Option(metavar="PATTERN", help="Find these too, such as 'arm*.azimuth_deg'; repeatable."),
]
Fix = Annotated[
    list[str] | None,
    typer.Option(
        metavar="PATTERN", help="Hold these at their nominal values, 'arm1.*'; repeatable."
    ),
]
