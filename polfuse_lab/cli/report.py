"""``polfuse report``: one page about a products file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from polfuse_lab.cli.output import Debug, Json, guarded, result


@guarded
def report(
    products: Annotated[Path, typer.Argument(metavar="PRODUCTS.h5", help="Products file.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="REPORT.html", help="The page to write.")],
    title: Annotated[str, typer.Option(help="Heading of the page.")] = "",
    json_: Json = False,
    debug: Debug = False,
) -> None:
    """Write one self-contained page: pictures, numbers with uncertainty, checks, provenance.

    Example: polfuse report products.h5 -o report.html
    """
    from polfuse_lab.report.builder import report as build

    page = build(products, output, title=title)
    result({"report": page}, as_json=json_, text=f"report: {page}")
