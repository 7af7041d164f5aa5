"""The consoles of the command line: what does not print is shown as escapes, a broken pipe ends the program."""

from __future__ import annotations

import sys
from collections.abc import Iterable

from rich.console import Console, ConsoleOptions, ConsoleRenderable, RenderableType, RenderHook
from rich.segment import Segment

from jaxdem.cli.process import BROKEN_PIPE
from jaxdem.errors import visible


class _Console(Console):
    """Ends the program as SIGPIPE does where who read the output has gone."""

    def on_broken_pipe(self) -> None:
        """Called at a broken pipe."""
        try:
            super().on_broken_pipe()
        except SystemExit:
            raise SystemExit(BROKEN_PIPE) from None


class _VisibleText(RenderHook):
    """Control characters in names of files, keys and messages are shown as escapes, wherever they stand."""

    def process_renderables(self, renderables: list[ConsoleRenderable]) -> list[ConsoleRenderable]:
        """What is printed in place of `renderables`."""
        return [_Visible(renderable) for renderable in renderables]


class _Visible:
    def __init__(self, content: RenderableType):
        self.content = content

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterable[Segment]:
        for text, style, control in console.render(self.content, options):
            yield Segment(text if control else visible(text), style, control)


def output() -> Console:
    """Console on standard output; tables are not wrapped to 80 columns in a file."""
    return _with_visible_text(_Console() if sys.stdout.isatty() else _Console(width=120))


def errors() -> Console:
    """Console on standard error."""
    return _with_visible_text(_Console(stderr=True, highlight=False, soft_wrap=True))


def _with_visible_text(console: Console) -> Console:
    console.push_render_hook(_VisibleText())
    return console
