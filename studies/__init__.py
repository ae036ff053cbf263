"""Guests of the pipeline: families of cases, which `config/studies/<study>.yaml` names under `cases`, one file each.

`validation` sets the solver beside exact solutions, `papers` repeats what others have published, and each folder of
`questions` answers one question of a surgeon, with cases and page together. The pipeline finds them by their names
(`pipeline.studies.guests`) and imports none of them. `results` makes the published tables of what they have found.

A file says in its docstring what is solved, cites the reference, and ends in a `Family` of `pipeline.studies.family`,
which says what every part of it is. What several families are made of is in folders named `kit`.
"""
