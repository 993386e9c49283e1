"""Prints a script that completes commands, options and names in your shell.

`eval "$(rodgym completion bash)"` switches completion on in a Bash that is open. To keep it, put
that line into the file that your shell reads when it starts, such as ~/.bashrc. The script for
another shell begins with the line for that shell.
"""

from __future__ import annotations

import argparse

SUMMARY = "print a script that completes commands and options in your shell"
EXAMPLES = """
rodgym completion bash
rodgym completion zsh
rodgym completion fish
"""
BASH = """\
# bash: eval "$(rodgym completion bash)"
_rodgym() {
  local IFS=$'\\n'
  local words="$(rodgym completion --words "${COMP_WORDS[@]:1:COMP_CWORD-1}" 2>/dev/null)"
  COMPREPLY=($(compgen -W "$words" -- "${COMP_WORDS[COMP_CWORD]}"))
}
complete -o default -F _rodgym rodgym
"""
ZSH = """\
# zsh: eval "$(rodgym completion zsh)"
_rodgym() {
  local -a found
  found=("${(@f)$(rodgym completion --words "${(@)words[2,CURRENT-1]}" 2>/dev/null)}")
  compadd -a found
  _files
}
compdef _rodgym rodgym
"""
FISH = """\
# fish: rodgym completion fish | source
function __rodgym_words
  set -l typed (commandline -opc)
  rodgym completion --words $typed[2..-1] 2>/dev/null
end
complete -c rodgym -a '(__rodgym_words)'
"""
SCRIPTS = {"bash": BASH, "zsh": ZSH, "fish": FISH}
#: Options and commands after which an environment, a controller or a policy is meant.
POLICIES = {"evaluate", "render", "robustness", "--policy", "--controller"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("shell", nargs="?", choices=tuple(SCRIPTS), help="the shell")
    parser.add_argument(
        "--words",
        nargs=argparse.REMAINDER,
        metavar="WORD",
        help="for the scripts: print what may follow these words, one a line",
    )


def run(args: argparse.Namespace) -> int:
    from rodgym.cli.arguments import UsageError

    if (args.shell is None) == (args.words is None):
        raise UsageError("name a shell: bash, zsh or fish")
    print("\n".join(following(args.words)) if args.shell is None else SCRIPTS[args.shell], end="")
    return 0


def following(words: list[str]) -> list[str]:
    """What may come after these words of a command line."""
    from rodgym.cli.app import command_names, load_command

    names = command_names()
    if not words:
        return [*names, "--help", "--version"]
    if words[0] not in names:
        return []
    last = words[-1]
    if last in ("list", "--env"):
        return environments()
    if last in POLICIES:
        from rodgym.evaluation import controller_names

        return [*controller_names(), "zoo"]
    parser = argparse.ArgumentParser(prog=words[0])
    load_command(words[0]).add_arguments(parser)
    # (argparse has no public list of its arguments.)
    for action in parser._actions:
        if last in action.option_strings and action.nargs != 0:
            return [str(choice) for choice in action.choices or ()]
    return [
        text
        for action in parser._actions
        for text in (action.option_strings or [str(choice) for choice in action.choices or ()])
        if text not in words
    ]


def environments() -> list[str]:
    """Names of the environments, as people type them."""
    from rodgym import ENVIRONMENTS

    return [name.rpartition("/")[2].partition("-v")[0] for name in ENVIRONMENTS]
