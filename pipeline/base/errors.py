"""The error that is meant for the user."""

FOR_DIGESTS = "no influence"


class UserError(Exception):
    """Something the user can put right: wrong input, a missing file, an impossible request.

    Parameters
    ----------
    *messages : one sentence each: what is wrong, where (file and key), and what is allowed.
    """

    def __init__(self, *messages: str):
        super().__init__("\n".join(messages))
        self.messages = messages
