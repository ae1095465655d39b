"""The ``polfuse`` command. Each command stands in a module of its own and imports what is heavy when it runs."""

from __future__ import annotations

import importlib

import typer

COMMANDS = (
    # module, function, name
    ("init", "init", "init"),
    ("design", "design", "design"),
    ("plan", "plan", "plan"),
    ("doctor", "doctor", "doctor"),
    ("trade", "trade", "trade"),
    ("sim", "sim", "sim"),
    ("collect", "collect", "collect"),
    ("info", "info", "info"),
    ("recover", "recover", "recover"),
    ("join", "join", "join"),
    ("replay", "replay", "replay"),
    ("import_", "import_", "import"),
    ("range_", "range_", "range"),
    ("focus", "focus", "focus"),
    ("calibrate", "calibrate", "calibrate"),
    ("analyse", "analyse", "analyse"),
    ("decompose", "decompose", "decompose"),
    ("detect", "detect", "detect"),
    ("optics", "optics", "optics"),
    ("raytrace", "raytrace", "raytrace"),
    ("simulate", "simulate", "simulate"),
    ("fuse", "fuse", "fuse"),
    ("motion", "motion", "motion"),
    ("export", "export", "export"),
    ("report", "report", "report"),
    ("demo", "demo", "demo"),
    ("gui", "gui", "gui"),
)


def build() -> typer.Typer:
    """The whole command-line application."""
    app = typer.Typer(
        name="polfuse",
        help="Rail polarimetric SAR and a polarization camera: collect, focus, calibrate, fuse.",
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    for module, function, name in COMMANDS:
        command = getattr(importlib.import_module(f"polfuse_lab.cli.{module}"), function)
        app.command(name)(command)
    return app


def main() -> None:
    """Entry point of the ``polfuse`` command."""
    build()()
