"""The command line: reads files and options, calls the library, says what happened.

Exit codes: 0 done, 1 the run failed, 2 the input is wrong, 130 and 143 after SIGINT and SIGTERM.
"""

from __future__ import annotations

from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from jaxdem.cli import finetune, networks, process, results, run, scenes, study, terminal
from jaxdem.cli.grouped_help import GroupedHelp
from jaxdem.errors import JaxdemError

OUT_OF_MEMORY = "RESOURCE_EXHAUSTED"


class Commands(TyperGroup):
    """The commands; what jaxdem raises on purpose becomes one message and an exit code."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """The first sentence of each, as many lines as it needs."""
        rows = [(name, self.commands[name].get_short_help_str(limit=200)) for name in self.list_commands(ctx)]
        with formatter.section("Commands"):
            formatter.write_dl(rows)

    def make_context(self, *args: Any, **options: Any) -> Any:
        """Read the arguments; `--help` and `--version` are printed here."""
        try:
            return super().make_context(*args, **options)
        except BrokenPipeError:
            raise SystemExit(process.BROKEN_PIPE) from None

    def invoke(self, ctx: Any) -> Any:
        """Run the command."""
        try:
            return super().invoke(ctx)
        except JaxdemError as error:
            terminal.fail(str(error), error.exit_code)
        except BrokenPipeError:  # who read the output has gone
            raise SystemExit(process.BROKEN_PIPE) from None
        except OSError as error:
            place, what = f"{error.filename}: " if error.filename else "", error.strerror or error
            terminal.fail(f"{place}{what}. Free some disk space or correct the permissions, and try again.", 1)
        except (MemoryError, RuntimeError) as error:
            if isinstance(error, RuntimeError) and OUT_OF_MEMORY not in str(error):
                raise
            first = (str(error).splitlines() or ["out of memory"])[0]
            remedy = "`jaxdem check` prints the estimated memory. Use fewer particles or cells."
            terminal.fail(f"Out of memory ({first}). {remedy}", 1)


app = typer.Typer(
    cls=Commands,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # plain help: rich's takes longer to load than all the rest
    help="Particles in a fluid (unresolved CFD-DEM), with learned drag closures.",
)


def main() -> None:
    """The command line of this process, with its exit code."""
    process.run(lambda: app(prog_name="jaxdem"))


def _version(wanted: bool) -> None:
    if wanted:
        from jaxdem.version import __version__

        typer.echo(f"jaxdem {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


app.command()(run.check)
app.command()(scenes.scene)
app.command("import")(scenes.import_scene)
app.command()(scenes.new)
app.command(cls=GroupedHelp)(run.run)
app.command()(networks.dataset)
app.command(cls=GroupedHelp)(networks.train)
app.command()(networks.evaluate)
app.command()(networks.distill)
app.command()(networks.prune)
app.command(cls=GroupedHelp)(finetune.finetune)
app.command()(networks.export)
app.command()(results.compare)
app.command()(results.plot)
app.command()(results.animate)
app.command()(run.sweep)
app.command()(study.study)


if __name__ == "__main__":
    main()
