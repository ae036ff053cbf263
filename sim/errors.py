"""What a run can end with."""


class RunError(RuntimeError):
    """The run cannot go on; the message is one sentence for the user: what happened, where, what may help."""
