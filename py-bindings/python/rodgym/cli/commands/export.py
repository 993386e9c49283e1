"""Writes a trained policy as one ONNX file, with everything that it does before its network.

A JSON file beside it says what goes in and what comes out: order, units, period.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from rodgym.cli.arguments import DEFAULT_ENV, UsageError, add_env, env_keywords

SUMMARY = "write a trained policy as an ONNX file"
EXAMPLES = """
rodgym export runs/distil-pendulumswingupbase
rodgym export zoo --env rodgym/PendulumSwingUpBase-v0 --out base.onnx
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("policy", help="a trained policy's file or run folder, or 'zoo'")
    add_env(parser, default=None)
    parser.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help="file to write, *.onnx (default: policy.onnx beside the policy; for 'zoo' in this "
        "folder)",
    )


def run(args: argparse.Namespace) -> int:
    from rodgym.cli.needs import need, of_env
    from rodgym.zoo import is_zoo

    zoo = is_zoo(args.policy)
    path = args.out or (Path() if zoo else Path(args.policy)) / "policy.onnx"
    if args.out is None and Path(args.policy).is_file():
        path = Path(args.policy).with_suffix(".onnx")
    if path.suffix != ".onnx":
        raise UsageError(f"--out {path}: the name must end in .onnx")
    need("stable_baselines3", "onnx", *of_env(args.env))
    from rodgym.export import export

    env_id = args.env or (DEFAULT_ENV if zoo else None)
    kwargs = env_keywords(env_id, args.env_arg) if env_id else dict(args.env_arg)
    sidecar = export(args.policy, path, env_id, kwargs)
    print(f"policy: {path}   (rodgym evaluate {path})")
    print(f"what its numbers mean: {sidecar}")
    return 0
