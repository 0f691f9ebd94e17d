"""Arguments and options that several commands share, worded once."""

from pathlib import Path
from typing import Annotated

import typer

from campaigns.errors import OptionsInvalid
from campaigns.estimation.estimators import Model

PICTURES = (".svg", ".png", ".pdf")
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


def picture_file(path: Path | None) -> Path | None:
    """Refuse at once what could not be written at the end."""
    if path is not None and path.suffix.lower() not in PICTURES:
        raise OptionsInvalid(
            f"--plot {path}: the name of a picture ends in {', '.join(PICTURES)}",
            remedy="let it end in one of them",
        )
    return path


Plot = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE", help="Draw a picture too: .svg, .png or .pdf.", callback=picture_file
    ),
]
ModelOption = Annotated[
    Model,
    typer.Option(
        "--model",
        help="paper, standard: lengths, places and joint offsets. rods: unequal rods too, which "
        "tilt the plate. full: tilted axes too, which do so as well. auto: the smallest that "
        "unseen pairs and BIC don't reject. extended: as auto, of where axes point and what gears "
        "lose.",
    ),
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
