"""Computes results of the thesis again and compares each claim with them, in tables, figures and
one HTML report.
"""

from __future__ import annotations

import argparse

from rodgym.cli.arguments import add_run

SUMMARY = "compute the results of a chapter of the thesis again"
EXAMPLES = """
rodgym reproduce chapter3
rodgym reproduce chapter4 --name thesis4
"""
CHAPTERS = ("chapter3", "chapter4")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("chapter", choices=CHAPTERS, help="which chapter")
    add_run(parser, words="default reproduce-CHAPTER")


def run(args: argparse.Namespace) -> int:
    import importlib

    from rodgym.cli.needs import need
    from rodgym.runs import Run

    need("matplotlib", "jinja2")
    module = importlib.import_module(f"rodgym.reproduction.{args.chapter}")
    folder = Run(args.name or f"reproduce-{args.chapter}", args.runs)
    folder.write_facts()
    for finding in module.reproduce(folder, lambda text: print(f"{text} ...", flush=True)):
        print(f"{finding.where}\n  found: {finding.result}\n  {finding.verdict}")
    print(f"report: {folder.file('report.html')}")
    return 0
