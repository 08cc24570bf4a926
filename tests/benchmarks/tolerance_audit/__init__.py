"""The audit of tolerances: whether a number that is ten times as large or as small makes an answer wrong.

`constants` finds the numbers and changes one before the framework is imported; `watched` tells which changes
a run feels; `scenes` says what is planned; `judge` holds plans against equations of motion; `runs` plans
scenes in a process of their own; `state` keeps what is done; `report` has the tables, and RESULT.md keeps
the last ones; `__main__` is `python -m tests.benchmarks.tolerance_audit`.
"""
