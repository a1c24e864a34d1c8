"""The errors that hairfit raises for what a user gave."""


class InputError(ValueError):
    """What the user gave cannot be used; one sentence says what to do.

    The command line prints it as one line and exits with status 2.
    """
