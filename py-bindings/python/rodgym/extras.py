"""Which extra of the package brings which module, and what is missing here.

A command asks `missing` before it works, for what it will use and no more.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Iterable
from itertools import combinations

#: Modules by extra, as `pyproject.toml` has them; small extras first, which are proposed first.
EXTRAS: dict[str, tuple[str, ...]] = {
    "render": ("pygame", "PIL", "imageio_ffmpeg"),
    "report": ("matplotlib", "jinja2", "PIL", "imageio_ffmpeg", "yaml"),
    "remote": ("zmq", "msgpack"),
    "export": ("onnx", "onnxruntime"),
    "data": ("pyarrow", "minari", "h5py"),
    "lab": (
        "cv2", "scipy", "pandas", "tables", "h5py", "pyarrow", "yaml", "matplotlib", "jinja2",
        "PIL",
    ),
    "ray": ("ray", "yaml", "matplotlib"),
    "tune": ("optuna",),
    "train": (
        "stable_baselines3", "sb3_contrib", "tensorboard", "torch", "rich", "tqdm",
        "matplotlib", "jinja2", "PIL", "imageio_ffmpeg", "yaml",
    ),
}  # fmt: skip


def installed(module: str) -> bool:
    """Whether a package can be imported; nothing is imported."""
    try:
        return importlib.util.find_spec(module) is not None
    except (ImportError, ValueError):
        return False


def extras_with(modules: Iterable[str]) -> tuple[str, ...] | None:
    """The fewest extras that bring all these modules; None where some module is in none."""
    wanted = set(modules)
    for count in range(1, len(EXTRAS) + 1):
        for names in combinations(EXTRAS, count):
            if wanted <= {module for name in names for module in EXTRAS[name]}:
                return names
    return None


def missing(needed: Iterable[str]) -> str | None:
    """What to install, in words, where one of the modules is not here; None where all are.

    The extras are chosen for all that is needed, so that one installation is enough.
    """
    needed = list(dict.fromkeys(needed))
    lacking = [module for module in needed if not installed(module)]
    if not lacking:
        return None
    extras = extras_with(needed) or extras_with(lacking)
    how = f": pip install 'rodgym[{','.join(extras)}]'" if extras else ""
    return f"this needs {' and '.join(lacking)}{how}"
