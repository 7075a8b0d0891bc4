"""Flag that this process runs a command of hcbench, so that all its resources are hcbench's own."""

from contextvars import ContextVar

IS_COMMAND = ContextVar("is_command", default=False)
