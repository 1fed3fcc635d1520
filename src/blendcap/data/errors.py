"""The one error that means: the input is at fault, not the program."""


class InputError(ValueError):
    """Input that blendcap cannot use. The message is one plain sentence: what, where, what to do."""
