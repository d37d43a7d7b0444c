"""Errors a user can act on: each message says what is wrong, where, and the mend."""


class CislunarError(Exception):
    """Base class of every error this library raises on purpose."""


class ConfigurationError(CislunarError, ValueError):
    """A setting is unknown, ill-typed or impossible; the message names its key."""


class InputFileError(CislunarError, ValueError):
    """A file is missing or holds something unusable; the message names the file and the place."""


class ConvergenceError(CislunarError, RuntimeError):
    """An iteration (corrector, continuation) did not reach its tolerance."""
