"""What a run can end with."""


class RunError(RuntimeError):
    """The run cannot go on; the message is one sentence for the user: what happened, where, what may help."""


class OutOfRoom(OverflowError):
    """An array of the solver is full; a solver with more head room can repeat the step (``Solver(head_room=...)``)."""
