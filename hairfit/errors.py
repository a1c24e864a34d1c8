"""The errors that hairfit raises for what a user gave."""


class InputError(ValueError):
    """What the user gave cannot be used; the message is one sentence that says what to do.

    The command line prints it as one line and exits with status 2.
    """
