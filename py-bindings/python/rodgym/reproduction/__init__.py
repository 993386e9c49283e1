"""The thesis' results, computed anew.

One module a chapter, each with `reproduce(run, progress)`.
"""
