"""A progress bar where there is a terminal, a line now and then where there is none."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType, TracebackType
from typing import Any

from rodgym.extras import installed


class Bar:
    """Progress of one long piece of work of ``total`` units.

    With a terminal and package rich, the text of ``say`` stands beside a bar; without, ``say``
    prints a line each.
    """

    def __init__(self, title: str, total: int, quiet: bool = False) -> None:
        self.title = title
        self.total = total
        self.quiet = quiet
        self.done = 0
        self.bar = None if quiet else _bar()
        self.task = None if self.bar is None else self.bar.add_task(title, total=total, text="")

    def __enter__(self) -> Bar:
        if self.bar is not None:
            self.bar.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self.bar is not None:
            self.bar.stop()

    def at(self, done: int, total: int | None = None) -> None:
        """Sets how much is done, and of how much, where that is known only now."""
        self.total = total or self.total
        self.done = min(done, self.total)
        if self.bar is not None:
            self.bar.update(self.task, completed=self.done, total=self.total)

    def say(self, text: str) -> None:
        """Shows where the work stands."""
        if self.bar is not None:
            self.bar.update(self.task, text=text)
        elif not self.quiet:
            share = self.done / self.total
            print(f"{self.title}: {share:4.0%}  {text}", file=sys.stderr, flush=True)


def _bar() -> Any:
    """A bar of rich; None where there is no terminal to draw it in, or no rich."""
    if not installed("rich"):
        return None
    from rich import progress
    from rich.console import Console

    console = Console(file=sys.stderr)
    if not console.is_terminal:
        return None
    return progress.Progress(
        progress.TextColumn("[bold]{task.description}"),
        progress.BarColumn(bar_width=30),
        progress.TaskProgressColumn(),
        progress.MofNCompleteColumn(),
        progress.TimeElapsedColumn(),
        progress.TextColumn("left"),
        progress.TimeRemainingColumn(),
        progress.TextColumn("{task.fields[text]}"),
        console=console,
    )


@contextmanager
def interrupt_flag() -> Iterator[threading.Event]:
    """Inside, the first Ctrl-C sets the flag instead of raising; the second one raises as usual."""
    flag = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield flag
        return
    before = signal.getsignal(signal.SIGINT)

    def on_interrupt(number: int, frame: FrameType | None) -> None:
        flag.set()
        signal.signal(signal.SIGINT, before)

    signal.signal(signal.SIGINT, on_interrupt)
    try:
        yield flag
    finally:
        signal.signal(signal.SIGINT, before)
