"""`example/PendulumLevel-v0`, a task written in Rust, beside rodgym's own environments.

Import this package before `rodgym`: rodgym then works on this package's extension, which is
rodgym's own with one more task in its catalogue. `python -m own_task` is the program `rodgym` with
it.
"""

import sys

if "rodgym" in sys.modules:
    raise ImportError("import own_task before rodgym")

from own_task import _extension

sys.modules["rodgym._native"] = _extension

import rodgym  # noqa: E402

rodgym._native = _extension
