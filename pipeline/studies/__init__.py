"""Families of cases, one file each: what `config/studies/<study>.yaml` may name under `cases`.

A file says in its docstring what is solved, cites the reference, and ends in a `Family` of `pipeline.study_kit.family`,
which says what every part of it is.
"""
