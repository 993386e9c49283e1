"""A progress bar where there is a terminal, a line now and then where there is none."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType, TracebackType

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)


class Bar:
    """Progress of one long piece of work of ``total`` units.

    Without a terminal, ``say`` prints a line each; with one, its text stands beside the bar.
    """

    def __init__(self, title: str, total: int, quiet: bool = False) -> None:
        self.title = title
        self.total = total
        self.quiet = quiet
        self.console = Console(file=sys.stderr)
        self.progress = Progress(
            TextColumn("[bold]{task.description}"),
            BarColumn(bar_width=30),
            TaskProgressColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            TextColumn("{task.fields[text]}"),
            console=self.console,
            disable=quiet or not self.console.is_terminal,
        )
        self.task = self.progress.add_task(title, total=total, text="")

    def __enter__(self) -> Bar:
        self.progress.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.progress.stop()

    def at(self, done: int) -> None:
        """Sets how much is done."""
        self.progress.update(self.task, completed=min(done, self.total))

    def say(self, text: str) -> None:
        """Shows where the work stands."""
        if self.progress.disable:
            if not self.quiet:
                done = self.progress.tasks[0].completed
                print(
                    f"{self.title}: {done / self.total:4.0%}  {text}", file=sys.stderr, flush=True
                )
        else:
            self.progress.update(self.task, text=text)


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
