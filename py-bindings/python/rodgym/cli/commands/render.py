"""Draws an episode: an animation (.gif, .mp4), a strip of stills (.png), or a window (--show)."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from rodgym.cli.arguments import (
    DEFAULT_ENV,
    UsageError,
    add_designs,
    add_env,
    add_normalize,
    at_most,
    designs,
    seed,
)

SUMMARY = "draw an episode as a GIF or film, a strip of stills, or in a window"
EXAMPLES = """
rodgym render lqr swing-up.gif
rodgym render runs/demo/policy.zip strip.png --seed 7 --stills 6
rodgym render lqr moments.png --at 0,0.2,0.4,0.8
rodgym render zoo --show
"""
#: Stills of 240 pixels side by side: a picture that programs still open.
MAX_STILLS = 100


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "policy", help="as for 'rodgym evaluate': a file, 'zoo', or a controller such as lqr"
    )
    parser.add_argument("out", nargs="?", type=Path, help="file to write: .gif, .mp4 or .png")
    add_env(parser, default=None)
    add_designs(parser)
    add_normalize(parser)
    parser.add_argument(
        "--seed", type=seed, default=0, metavar="N", help="seed of the episode (default 0)"
    )
    parser.add_argument(
        "--stills",
        type=at_most(MAX_STILLS),
        default=5,
        metavar="N",
        help=f"pictures in a .png strip (default 5, at most {MAX_STILLS}), close together where "
        "much moves",
    )
    parser.add_argument(
        "--at", type=times, metavar="T,...", help="times [s] of the pictures in a .png strip"
    )
    parser.add_argument("--show", action="store_true", help="play it in a window")


def times(text: str) -> list[float]:
    """Times separated by commas."""
    try:
        read = [float(part) for part in text.split(",")]
    except ValueError:
        read = [-1.0]
    if len(read) > MAX_STILLS or not all(0 <= time < float("inf") for time in read):
        raise argparse.ArgumentTypeError(
            f"{text!r} is not a list of at most {MAX_STILLS} times in seconds such as 0,0.2,0.4"
        )
    return read


def run(args: argparse.Namespace) -> int:
    from rodgym.cli.entrants import resolve_env, title
    from rodgym.cli.needs import need, of_env, of_policy
    from rodgym.evaluation import record
    from rodgym.evaluation.design import NOMINAL

    if args.show == (args.out is not None):
        raise UsageError("give a file to write, or --show for a window")
    if args.out and args.out.suffix not in (".gif", ".mp4", ".png"):
        raise UsageError(f"cannot write {args.out}: its name must end in .gif, .mp4 or .png")
    if args.out and not args.out.parent.is_dir():
        raise UsageError(f"cannot write {args.out}: there is no folder {args.out.parent}")
    if args.out and args.out.is_dir():
        raise UsageError(f"cannot write {args.out}: it is a folder")
    env_id, env_kwargs = resolve_env(args.policy, args.env, dict(args.env_arg), DEFAULT_ENV)
    drawn = "pygame" if args.show else "PIL"
    film = ("imageio_ffmpeg",) if args.out and args.out.suffix == ".mp4" else ()
    need(drawn, *film, *of_policy(args.policy), *of_env(env_id))
    asked = designs(args.design)
    if len(asked) > 1:
        raise UsageError("--design: one episode has one design")
    design = asked[0] if asked else None
    if args.show:
        shown = {**env_kwargs, "render_mode": "human"}
        record(
            args.policy,
            env_id,
            args.seed,
            env_kwargs=shown,
            design=design,
            normalize=args.normalize,
        )
        return 0
    from rodgym.report import animation
    from rodgym.report.gif import write_gif

    if args.out.suffix == ".png":
        env_kwargs["render_size"] = still_size(env_id, env_kwargs, animation.STILL)
    episode = record(
        args.policy,
        env_id,
        args.seed,
        env_kwargs=env_kwargs,
        name=title(args.policy),
        design=design,
        normalize=args.normalize,
        frame_rate=25.0,
    )
    if args.out.suffix == ".gif":
        write_gif(args.out, animation.side_by_side([episode], 480), episode.frame_dt)
    elif args.out.suffix == ".mp4":
        animation.write_mp4(args.out, animation.side_by_side([episode], 480), episode.frame_dt)
    else:
        chosen = (
            animation.at_times(episode, args.at)
            if args.at
            else animation.moments(episode, args.stills)
        )
        animation.strip(episode, chosen).save(args.out)
    made_for = f" ({episode.design})" if episode.design not in ("", NOMINAL) else ""
    print(
        f"{args.out}: {episode.time[-1]:.1f} s of {env_id}, return {episode.rewards.sum():.1f}"
        f"{made_for}"
    )
    return 0


def still_size(env_id: str, env_kwargs: dict[str, Any], width: int) -> tuple[int, int]:
    """Sides of a picture of this width, in the shape that suits the machine."""
    from rodgym.evaluation.conditions import make_single

    env = make_single(env_id, {**env_kwargs, "render_mode": "rgb_array"})
    try:
        env.reset(seed=0)
        height, whole, _ = env.render().shape
    finally:
        env.close()
    return width, round(height * width / whole)
