"""Families of cases, one file each: what `config/studies/<study>.yaml` may name under `cases`.

A family has a frozen dataclass `Parameters` and a function `run(parameters) -> Outcome`. It may have `FIGURES`,
`PICTURES` (names of PNG files that it makes itself), `EFFECTS` (names of the effects it uses, for the digest),
`scenes(parameters)` (names of the scenes whose results it reads) and `READS` (folders and files of these scenes that it
reads beside their metrics: frames if nothing is said), and `solves(parameters)` (names of the scenes that it runs by
itself, with numerics of its own). Its docstring says what is solved, and cites the reference.
"""
