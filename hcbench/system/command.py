"""Flags of what runs hcbench: its own command line, or a program in Python."""

from contextvars import ContextVar

# This process runs a command of hcbench, so that all its resources are hcbench's own.
IS_COMMAND = ContextVar("is_command", default=False)
# The user is at the command line: a message names options, `--max-error`, and
# not parameters, `max_error`.
NAMES_OPTIONS = ContextVar("names_options", default=False)
