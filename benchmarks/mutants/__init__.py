"""Mutation testing of all packages: faults are put in one by one, and the tests that cover the place must find them.

Existing tools were tested first. mutmut 3 also forks from a process that has everything imported, but it mutates whole
packages rather than a drawn sample (64,000 lines make some 10⁵ mutants), calls each function through a trampoline that
numba cannot compile, names mutants by their ordinal in the function, so that a list does not survive an edit, and does
not reach processes that a test starts. cosmic-ray writes each mutant to disk, runs one command for all of them with no
choice of tests, and locates by occurrence in a file; mutatest and mutpy are no longer maintained (Python ≤ 3.8).

How it works: ``operators`` lists the faults of a function's syntax tree, ``draw`` chooses among them by hash,
``places`` and ``entries`` find a listed fault again after edits, moves and renaming. ``coverage`` runs each test once
with a mark in every function; ``session`` is one pytest session that has collected all tests and forks a process for
each mutant: there the function's code is exchanged (``apply``), numba kernels that contain it are compiled afresh
without their cache (``kernels``), and the covering tests run, the nearest and shortest first, until one fails. A test
that fails is run once more without the fault, so a flaky one finds nothing. Processes that a test starts import the
mutated module through ``inject/sitecustomize.py``.
"""
