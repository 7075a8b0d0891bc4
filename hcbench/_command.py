"""Whether this process is a command of hcbench: then all that it holds is hcbench's own."""

from contextvars import ContextVar

IS_COMMAND = ContextVar("is_command", default=False)
